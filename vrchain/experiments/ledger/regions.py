"""Parallel ledgers, one a region: what a robot saves that follows those alone that it can see into.

A region is a rectangle of the map with a stream of its own, into which the robots that stand there
publish. Robots stand in free space, each with one panorama. Which landmarks two of them have in
common is known by truth; one is missed where the other's panorama lies in a region that is not
followed. Bytes are counted as in ``transmission``: the ledger has no such way yet.
"""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vrchain.experiments.landmarks.pairs import draw_poses
from vrchain.experiments.ledger.cluster import PAYLOAD_BYTES
from vrchain.experiments.ledger.transmission import SERVERS, message_sizes
from vrchain.geometry import Pose
from vrchain.landmarks.quality import Sights, shared
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world.model import Scene
from vrchain.world.truth import GroundTruth

ROBOTS, FIELDS = 50, (2, 2)
NEAR_M = (40.0, 20.0, 10.0)
ONE, SEEN, OWN = "one ledger of all", "regions of what it sees", "its own region"
COLUMNS = [
    "follows", "robots", "regions", "received_bytes", "bytes", "common", "missed", "landmarks",
    "lost",
]  # fmt: skip

Follows = Mapping[str, NDArray[np.bool_]]
"""By way: whether each robot follows each region, (robots, regions)."""


def regional(
    scene: Scene,
    robots: int = ROBOTS,
    fields: tuple[int, int] = FIELDS,
    payload_bytes: int = PAYLOAD_BYTES,
    *,
    seed: int = 0,
) -> pd.DataFrame:
    """One row a way of choosing what to follow. Columns: COLUMNS.

    regions: followed, and received_bytes, of a robot on average. bytes: on all wires. common:
    landmarks that a robot has in common with another's panorama, over all robots and panoramas;
    missed: those of them whose panorama it does not get. landmarks: those that a robot has in
    common with anybody, over all robots; lost: those that it has in common with nobody's panorama
    that it gets.
    """
    rig, truth = CameraRig(), GroundTruth(scene)
    poses = draw_poses(scene, robots, generator(seed, "regions"))
    sights = [Sights(truth, pose, rig) for pose in poses]
    xy_m = np.array([pose.xy_m for pose in poses])
    own = region_of(xy_m, scene.extent_m, fields)
    in_common = {
        (i, j): set(shared(truth, sights[i], sights[j]))
        for i in range(robots)
        for j in range(i + 1, robots)
    }
    offer, block = message_sizes(robots, payload_bytes, seed)[0]
    rows = []
    for way, follows in _ways(scene, poses, sights, own, fields).items():
        gets = follows[:, own]  # whether robot i gets the panorama of robot j
        common, missed = 0, 0
        known: list[set[int]] = [set() for _ in poses]
        still: list[set[int]] = [set() for _ in poses]
        for pair, found in in_common.items():
            for i, j in (pair, pair[::-1]):
                common, missed = common + len(found), missed + len(found) * (not gets[i, j])
                known[i] |= found
                still[i] |= found if gets[i, j] else set()
        n_known, n_still = (sum(map(len, each)) for each in (known, still))
        received = gets.sum() * block
        wires = robots * (offer * (SERVERS + 1) + block * SERVERS) + received
        counts = common, missed, n_known, n_known - n_still
        rows.append((way, robots, follows.sum(axis=1).mean(), received / robots, wires, *counts))
    return pd.DataFrame(rows, columns=COLUMNS)


def region_of(
    xy_m: NDArray[np.float64], extent_m: tuple[float, float], fields: tuple[int, int]
) -> NDArray[np.int64]:
    """The region in which each place, (n, 2), lies, (n,); the map's centre is at (0, 0)."""
    share = xy_m / np.array(extent_m) + 0.5
    column, row = np.clip((share * fields).astype(int), 0, np.array(fields) - 1).T
    return row * fields[0] + column


def away_m(
    xy_m: NDArray[np.float64], extent_m: tuple[float, float], fields: tuple[int, int]
) -> NDArray[np.float64]:
    """How far each place, (n, 2), is from each region, (n, regions); 0 within it."""
    size_m = np.array(extent_m) / fields
    row, column = np.divmod(np.arange(fields[0] * fields[1]), fields[0])
    low_m = np.stack([column, row], axis=-1) * size_m - np.array(extent_m) / 2
    beside_m = np.maximum(low_m - xy_m[:, None], xy_m[:, None] - low_m - size_m)
    return np.linalg.norm(np.maximum(beside_m, 0.0), axis=-1)


def _ways(
    scene: Scene,
    poses: list[Pose],
    sights: list[Sights],
    own: NDArray[np.int64],
    fields: tuple[int, int],
) -> Follows:
    n_regions = fields[0] * fields[1]
    at_m = np.array([o.bounds_m.mean(axis=0)[:2] for o in scene.objects])
    lies = region_of(at_m, scene.extent_m, fields)
    at_home = np.eye(n_regions, dtype=bool)[own]
    sees = at_home.copy()
    for i, each in enumerate(sights):
        sees[i, [lies[k] for k in each.visible if scene.objects[k].landmark]] = True
    distance_m = away_m(np.array([pose.xy_m for pose in poses]), scene.extent_m, fields)
    return {
        ONE: np.ones((len(poses), n_regions), dtype=bool),
        **{f"regions within {most_m:g} m": distance_m <= most_m for most_m in NEAR_M},
        SEEN: sees,
        OWN: at_home,
    }
