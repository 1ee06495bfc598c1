"""What a network that is never wrong would answer, for a made-up view of some things."""

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import Pose, circular_mean_rad, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import BEARING_UNIT_RAD, RANGE_UNIT_M, from_answers
from vrchain.landmarks.extraction.raster import (
    CELL_PX,
    COLUMNS,
    ROWS,
    cell_bearings_rad,
    cell_slopes,
)
from vrchain.landmarks.extraction.record import LandmarkRecord
from vrchain.landmarks.extraction.sift import NO_FEATURES, Features
from vrchain.landmarks.extraction.spots import descriptors_of, spots_of
from vrchain.panorama import CameraRig
from vrchain.seeding import generator

RIG = CameraRig()
SHAPE = ROWS // CELL_PX, COLUMNS // CELL_PX
KINDS, EMBEDDED, LOCAL = 15, 64, 32


def looks(n: int, name: str = "looks") -> NDArray[np.float64]:
    """Unit vectors, (n, EMBEDDED), no two alike."""
    drawn = generator(0, name).normal(size=(n, EMBEDDED))
    return drawn / np.linalg.norm(drawn, axis=1, keepdims=True)


def posts(pose: Pose, centres_m: NDArray[np.float64], width_m: float = 2.0, height_m: float = 3.0):
    """Object id a cell, -1 for none, of posts standing around, the nearer before the farther."""
    cells = np.full(SHAPE, -1)
    bearings, slopes = cell_bearings_rad(RIG), cell_slopes()
    away = np.asarray(centres_m) - pose.xy_m
    range_m = np.hypot(*away.T)
    for i in np.argsort(-range_m):
        bearing = np.arctan2(away[i, 1], away[i, 0]) - pose.yaw_rad
        wide = np.abs(wrap_angle_rad(bearings - bearing)) <= np.arctan(width_m / 2 / range_m[i])
        tall = (slopes >= -1.0 / range_m[i]) & (slopes <= (height_m - 1.0) / range_m[i])
        cells[np.ix_(tall, wide)] = i
    return cells


def perfect(
    cells: NDArray[np.int64],
    pose: Pose,
    centres_m: NDArray[np.float64],
    embedding: NDArray[np.float64],
) -> dict[str, NDArray[np.float32]]:
    """The answers for these cells."""
    channels = {"landmark": 1, "fit": 1, "box": 4, "middle": 4, "kind": KINDS,
                "embedding": EMBEDDED, "local": LOCAL}  # fmt: skip
    found = {name: np.zeros((n, *SHAPE), dtype=np.float32) for name, n in channels.items()}
    found["landmark"] -= 8.0
    waves = generator(0, "waves").normal(size=(3, LOCAL // 2))
    bearings = cell_bearings_rad(RIG)
    for i in np.unique(cells[cells >= 0]):
        row, column = np.nonzero(cells == i)
        turn = 2 * np.pi / SHAPE[1]
        around = wrap_angle_rad(column * turn - circular_mean_rad(column * turn)) / turn
        away = np.asarray(centres_m)[i] - pose.xy_m
        offset = wrap_angle_rad(np.arctan2(away[1], away[0]) - pose.yaw_rad - bearings[column])
        at = (slice(None), row, column)
        found["landmark"][at] = 8.0
        edges = [around - around.min(), row - row.min(), around.max() - around, row.max() - row]
        found["box"][at] = np.log(np.stack(edges) + 0.5)
        # the middle cell's box fits best
        found["fit"][at] = 4.0 - 0.1 * np.hypot(around, row - row.mean())
        known = np.log([np.hypot(*away) / RANGE_UNIT_M, 0.02, 0.05])
        found["middle"][at] = np.vstack(
            [offset / BEARING_UNIT_RAD, *np.tile(known, (len(row), 1)).T]
        )
        found["kind"][at] = np.eye(KINDS)[i % KINDS][:, None] * 5
        found["embedding"][at] = embedding[i][:, None]
        # each spot by which thing it is on, how high, and how far to its side
        high_m, aside_m = (x * np.hypot(*away) for x in (cell_slopes()[row], around * turn))
        spot = np.stack([np.full(len(row), 7.0 * i), 3 * high_m, 3 * aside_m], axis=1)
        phase = spot @ waves
        found["local"][at] = np.concatenate([np.cos(phase), np.sin(phase)], axis=1).T
    return found


def said(pose: Pose, centres_m: NDArray[np.float64]) -> dict[str, NDArray[np.float32]]:
    """The answers for things at these places, no two alike."""
    return perfect(posts(pose, centres_m), pose, centres_m, looks(len(centres_m)))


def record(
    pose: Pose, centres_m: NDArray[np.float64], features: Features = NO_FEATURES
) -> LandmarkRecord:
    """The record of a panorama that shows them."""
    answered = said(pose, centres_m)
    proposals = from_answers(answered, RIG)
    spots = spots_of(proposals, RIG, descriptors_of(proposals, answered["local"]))
    return LandmarkRecord(RIG, "ab" * 32, proposals, features, spots)
