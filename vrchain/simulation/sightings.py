"""What a team's robots see, by truth: the landmarks of each, and those that two have in common."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import pandas as pd

from vrchain.geometry import Pose
from vrchain.landmarks.quality import co_visible
from vrchain.panorama import CameraRig
from vrchain.world.model import Scene
from vrchain.world.truth import GroundTruth


@dataclass(frozen=True)
class Sightings:
    """visible: names of the landmarks that each robot sees; common: co-visible ones of each pair.

    Pairs are in the order of the robots, as in ("R1", "R2"); one without any is left out.
    """

    visible: dict[str, tuple[str, ...]]
    common: dict[tuple[str, str], tuple[str, ...]]

    def labels(self) -> dict[str, str]:
        """Short names of the common landmarks, as the paper has them: L12, L23.

        Letters tell several of one pair apart: L12a, L12b, after L12z L12aa. From ten robots on:
        L1-12, L11-2. One that several pairs share is known by the first of them.
        """
        found: dict[str, str] = {}
        for (a, b), names in self.common.items():
            for k, name in enumerate(names):
                one, other = a.lstrip("R"), b.lstrip("R")
                pair = f"{one}{other}" if len(one) == len(other) == 1 else f"{one}-{other}"
                found.setdefault(name, f"L{pair}{_letters(k) if len(names) > 1 else ''}")
        return found

    def others(self, robot: str) -> list[str]:
        """The landmarks that a robot sees and has in common with no other."""
        shared = {n for pair, names in self.common.items() if robot in pair for n in names}
        return [n for n in self.visible[robot] if n not in shared]


def _letters(k: int) -> str:
    """a to z, then aa, ab, ..."""
    return (_letters(k // 26 - 1) if k >= 26 else "") + chr(ord("a") + k % 26)


def team_sightings(
    scene: Scene, robots: Mapping[str, Pose], rig: CameraRig | None = None
) -> Sightings:
    """The sightings of robots at their poses."""
    truth, rig = GroundTruth(scene), rig or CameraRig()
    visible = {}
    for name, pose in robots.items():
        seen = truth.visibility(pose, rig)
        things = [scene.objects[i] for i in seen.index[seen.visible]]
        visible[name] = tuple(t.name for t in things if t.landmark)
    common = {}
    for a, b in combinations(robots, 2):
        found = co_visible(truth, robots[a], robots[b], rig)
        if found:
            common[a, b] = tuple(scene.objects[i].name for i in found)
    return Sightings(visible, common)


def sightings_table(scene: Scene, robots: Mapping[str, Pose], sightings: Sightings) -> pd.DataFrame:
    """One row a robot and landmark: poses, the landmark's middle, and with whom it is in common."""
    rows, labels = [], sightings.labels()
    for robot, pose in robots.items():
        for name in sightings.visible[robot]:
            thing = scene.objects[scene.index_of(name)]
            x_m, y_m, _ = thing.bounds_m.mean(axis=0)
            pairs = [p for p, names in sightings.common.items() if robot in p and name in names]
            partners = [other for pair in pairs for other in pair if other != robot]
            rows.append(
                {
                    "robot": robot, "robot_x_m": pose.x_m, "robot_y_m": pose.y_m,
                    "robot_yaw_rad": pose.yaw_rad, "landmark": name, "kind": thing.kind,
                    "landmark_x_m": x_m, "landmark_y_m": y_m, "in_common_with": " ".join(partners),
                    "label": labels[name] if partners else "",
                }
            )  # fmt: skip
    return pd.DataFrame(rows)
