"""Eyes that cannot err: landmarks as truth has them, for the arm that missions are measured by."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.homing import HomeVector
from vrchain.landmarks.extraction.proposer import Proposals, nothing
from vrchain.landmarks.extraction.record import LandmarkRecord, decode_record
from vrchain.landmarks.extraction.sift import NO_FEATURES
from vrchain.landmarks.matching.calibration import Calibration
from vrchain.landmarks.matching.claims import regions_of
from vrchain.landmarks.matching.common import CommonLandmark, Comparison
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.landmarks.quality import Sights, shared
from vrchain.navigation.goal.place import ARRIVED_M, GoalPlace
from vrchain.navigation.goal.recognition import GoalSight, any_sight
from vrchain.navigation.perception import Look, Perception, surface_m
from vrchain.panorama import CameraRig
from vrchain.robot import Observation
from vrchain.seeding import generator
from vrchain.world.truth import GroundTruth

_DIMENSIONS = 64
_SAME, _ENOUGH = 0.99, 1000  # cosine of one thing with itself, and keypoints that prove it
_ALIKE = 10.0  # log-likelihood ratio of looks that prove it
_CALIBRATION = Calibration(alike_scale=20.0, alike_even=0.8)
_NONE = np.empty(0, dtype=np.int64)
_NOBODY = "0" * 64  # no weights made its records


class Oracle:
    """What is truly visible from where pictures were taken."""

    def __init__(self, truth: GroundTruth, rig: CameraRig) -> None:
        self.truth, self.rig = truth, rig
        self._taken: dict[int, tuple[Look, Pose]] = {}
        self._sights = cache(lambda pose: Sights(truth, pose, rig))

    def perception(self, here: Callable[[], Pose], stored: Callable[[bytes], Pose]) -> Perception:
        """The eyes of a robot. here: its true pose; stored: that of a panorama, by its bytes."""

        def examine(seen: Observation) -> Look:
            return self._look(here())

        def published(panorama: bytes, landmarks: bytes | None) -> Look:
            record = None if landmarks is None else decode_record(landmarks)
            return self._look(stored(panorama), record)

        return Perception(examine, published, self.compare, _CALIBRATION)

    def record(self, seen: Observation) -> LandmarkRecord:
        """An empty one, to publish how the robot moved by."""
        return LandmarkRecord(self.rig, _NOBODY, nothing(), NO_FEATURES)

    def goal(self, name: str, share: float) -> "TrueGoal":
        """The goal, known by what it is, and looked at from that share of 6 to 15 m."""
        return TrueGoal(_embedding(name), share)

    def place(self, pose: Pose, perception: Perception) -> "TruePlace":
        """A place as a goal."""
        return TruePlace(self._look(pose), perception, self)

    def bearing_and_range_m(self, a: Look, b: Look) -> tuple[float, float]:
        """Where one look was taken, seen from the other."""
        here, there = self._taken[id(a)][1], self._taken[id(b)][1]
        return here.bearing_to_rad(there.xy_m), here.distance_to_m(there.xy_m)

    def compare(self, a: Look, b: Look) -> Comparison:
        """The landmarks that are truly co-visible, and the true relative pose."""
        pose_a, pose_b = self._taken[id(a)][1], self._taken[id(b)][1]
        both = shared(self.truth, self._sights(pose_a), self._sights(pose_b))
        claims = []
        for i in both:
            regions = []
            for p in (a.proposals, b.proposals):
                own = _index_of(p, _embedding(self.truth.scene.objects[i].name))
                regions += regions_of(p, np.array([own]), self.rig) if own is not None else []
            if len(regions) == 2:
                claims.append(CommonLandmark(1.0, regions[0], regions[1], _NONE, _NONE))
        geometry = PlanarGeometry(
            pose_a.bearing_to_rad(pose_b.xy_m),
            float(wrap_angle_rad(pose_b.yaw_rad - pose_a.yaw_rad)),
            np.ones(len(claims), dtype=bool),
            0.0,
            pose_a.distance_to_m(pose_b.xy_m) / self.rig.camera_height_m,
        )
        return Comparison(tuple(claims), geometry)

    def _look(self, pose: Pose, record: LandmarkRecord | None = None) -> Look:
        sights = self._sights(pose)
        ids, points = sights.surface
        objects = self.truth.scene.objects
        chosen = sorted(i for i in sights.visible if objects[i].landmark)
        bearing, range_m, box = [], [], []
        for i in chosen:
            own = points[ids == i]
            if len(own) == 0:
                own = np.append(objects[i].bounds_m.mean(axis=0)[:2], 1.0)[None]
            middle = objects[i].bounds_m[:, :2].mean(axis=0)
            bearing.append(pose.bearing_to_rad(middle))
            range_m.append(pose.distance_to_m(middle))
            box.append(self._box(pose, own))
        n = len(chosen)
        proposals = Proposals(
            np.ones(n), np.array(box).reshape(n, 4), np.array(bearing), np.array(range_m),
            np.full(n, 0.01), np.full(n, 0.02), np.zeros(n, dtype=np.int64),
            np.array([_embedding(objects[i].name) for i in chosen], dtype=np.float32)
            .reshape(n, _DIMENSIONS), _NONE, _NONE,
        )  # fmt: skip
        look = Look(self.rig, proposals, lambda: NO_FEATURES, record=record)
        self._taken[id(look)] = look, pose
        return look

    def _box(self, pose: Pose, points_m: NDArray[np.float64]) -> tuple[float, float, float, float]:
        """The box of what is seen; its lower edge is where the nearest point stands."""
        offset_m, height_m = points_m[:, :2] - pose.xy_m, self.rig.camera_height_m
        away_m = np.hypot(*offset_m.T)
        angle = np.arctan2(offset_m[:, 1], offset_m[:, 0]) - pose.yaw_rad
        middle = float(np.arctan2(np.sin(angle).mean(), np.cos(angle).mean()))
        off = wrap_angle_rad(angle - middle)
        return (
            middle + float(off.min()), middle + float(off.max()), -height_m / float(away_m.min()),
            float(((points_m[:, 2] - height_m) / away_m).max()),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class TrueGoal:
    """A goal that is never taken for anything else."""

    embedding: NDArray[np.float32]
    share: float

    def find(
        self,
        look: Look,
        near_rad: float | None = None,
        window_rad: float = 0.4,
        fair: Callable[[GoalSight], bool] = any_sight,
    ) -> GoalSight | None:
        """The goal, if it is in view."""
        p = look.proposals
        k = _index_of(p, self.embedding)
        if k is None:
            return None
        bearing, half_rad = float(p.box[k, :2].mean()), float(np.ptp(p.box[k, :2])) / 2
        if near_rad is not None:
            off_rad = abs(float(wrap_angle_rad(bearing - near_rad)))
            if off_rad > half_rad + window_rad:
                return None
        sight = GoalSight(
            float(wrap_angle_rad(bearing)), float(p.range_m[k]), surface_m(look, k), half_rad,
            _ENOUGH, _ALIKE, 1.0,
        )  # fmt: skip
        return sight if fair(sight) else None

    def promise(self, look: Look) -> NDArray[np.float64]:
        """The same for all: what it looks like does not matter to who cannot err."""
        return np.full(len(look.proposals), 0.01)


def _index_of(p: Proposals, embedding: NDArray[np.float32]) -> int | None:
    """Which proposal is the thing of an embedding, if any."""
    alike = p.embedding @ embedding
    return int(alike.argmax()) if len(alike) and alike.max() > _SAME else None


def _embedding(name: str) -> NDArray[np.float32]:
    drawn = generator(0, "oracle", name).normal(size=_DIMENSIONS)
    return np.asarray(drawn / np.linalg.norm(drawn), dtype=np.float32)


@dataclass(frozen=True, eq=False)
class TruePlace(GoalPlace):
    """A place to which homing never errs."""

    oracle: Oracle

    def homing(self, look: Look) -> HomeVector | None:
        """The true way there."""
        bearing_rad, range_m = self.oracle.bearing_and_range_m(look, self.look)
        return HomeVector(bearing_rad, 0.0, _ENOUGH, range_m <= ARRIVED_M, range_m)
