"""What a network that is never wrong would answer, for a made-up view of some things."""

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import BEARING_UNIT_RAD, RANGE_UNIT_M
from vrchain.landmarks.extraction.raster import (
    CELL_PX,
    COLUMNS,
    ROWS,
    cell_bearings_rad,
    cell_slopes,
)
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
    found = {
        "landmark": np.full((1, *SHAPE), -8.0, dtype=np.float32),
        "fit": np.zeros((1, *SHAPE), dtype=np.float32),
        "box": np.zeros((4, *SHAPE), dtype=np.float32),
        "middle": np.zeros((4, *SHAPE), dtype=np.float32),
        "kind": np.zeros((KINDS, *SHAPE), dtype=np.float32),
        "embedding": np.zeros((EMBEDDED, *SHAPE), dtype=np.float32),
        "local": np.zeros((LOCAL, *SHAPE), dtype=np.float32),
    }
    waves = generator(0, "waves").normal(size=(3, LOCAL // 2))
    bearings = cell_bearings_rad(RIG)
    for i in np.unique(cells[cells >= 0]):
        row, column = np.nonzero(cells == i)
        turn = 2 * np.pi / SHAPE[1]
        angle = column * turn
        around = wrap_angle_rad(angle - np.arctan2(np.sin(angle).mean(), np.cos(angle).mean()))
        around = around / turn
        away = np.asarray(centres_m)[i] - pose.xy_m
        offset = wrap_angle_rad(np.arctan2(away[1], away[0]) - pose.yaw_rad - bearings[column])
        at = (slice(None), row, column)
        found["landmark"][at] = 8.0
        edges = [around - around.min(), row - row.min(), around.max() - around, row.max() - row]
        found["box"][at] = np.log(np.stack(edges) + 0.5)
        # the middle cell's box fits best
        found["fit"][at] = 4.0 - 0.1 * np.hypot(around, row - row.mean())
        found["middle"][at] = np.stack(
            [
                offset / BEARING_UNIT_RAD,
                np.full(len(row), np.log(np.hypot(*away) / RANGE_UNIT_M)),
                np.full(len(row), np.log(0.02)),
                np.full(len(row), np.log(0.05)),
            ]
        )
        found["kind"][at] = np.eye(KINDS)[i % KINDS][:, None] * 5
        found["embedding"][at] = embedding[i][:, None]
        # each spot by which thing it is on, how high, and how far to its side
        high_m, aside_m = (x * np.hypot(*away) for x in (cell_slopes()[row], around * turn))
        spot = np.stack([np.full(len(row), 7.0 * i), 3 * high_m, 3 * aside_m], axis=1)
        phase = spot @ waves
        found["local"][at] = np.concatenate([np.cos(phase), np.sin(phase)], axis=1).T
    return found
