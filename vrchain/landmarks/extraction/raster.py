"""The picture that the network sees, and the directions of its cells.

A panorama's cylinder at one scale whatever the rig, so that an angle is always as many pixels.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.panorama import CameraRig, Panorama

COLUMNS = 2160  # a full turn: 6 pixels a degree
ROWS = 272
CELL_PX = 4  # the network answers for every square of so many pixels
PX_PER_RAD = COLUMNS / (2 * np.pi)
_MULTIPLE = 16  # the network's coarsest stride


def picture_of(panorama: Panorama) -> NDArray[np.uint8]:
    """The cylinder at ``PX_PER_RAD``: (ROWS, columns, 3) uint8 RGB, its middle row the horizon.

    What the rig does not see above and below repeats its outermost rows.
    """
    return _scaled(panorama.cylinder, panorama.rig)


def unseen_cells(panorama: Panorama) -> NDArray[np.bool_] | None:
    """Cells of which, or beside which, something is masked: (rows, columns); None: none is."""
    seen = panorama.seen_cylinder
    if seen is None:
        return None
    shown = _scaled(seen.astype(np.uint8) * np.uint8(255), panorama.rig)
    cells = shown.shape[1] // CELL_PX, ROWS // CELL_PX
    least = cv2.resize(shown, cells, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.erode(least, np.ones((3, 3), np.uint8)) < 255)


def _scaled(cylinder: NDArray[np.uint8], rig: CameraRig) -> NDArray[np.uint8]:
    columns = columns_of(rig)
    scale = PX_PER_RAD / rig.px_per_rad
    rows = max(2, 2 * round(cylinder.shape[0] * scale / 2))
    shrinks = scale < 1
    small = cv2.resize(
        cylinder, (columns, rows), interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    )
    missing = (ROWS - rows) // 2
    if missing < 0:
        small = small[-missing : rows + missing]
    elif missing > 0:
        around = ((missing, missing), (0, 0), (0, 0))
        small = np.pad(small, around[: small.ndim], mode="edge")
    return np.ascontiguousarray(small, dtype=np.uint8)


def columns_of(rig: CameraRig) -> int:
    """Columns of a rig's picture."""
    return max(1, round(rig.span_rad * PX_PER_RAD / _MULTIPLE)) * _MULTIPLE


def cell_bearings_rad(rig: CameraRig) -> NDArray[np.float64]:
    """Bearing of each column of cells, (columns / CELL_PX,)."""
    n = columns_of(rig) // CELL_PX
    return np.asarray(rig.span_rad / 2 - (np.arange(n) + 0.5) * rig.span_rad / n, dtype=float)


def cell_slopes() -> NDArray[np.float64]:
    """Slope (tangent of elevation) of each row of cells, (ROWS / CELL_PX,)."""
    middle_px = (np.arange(ROWS // CELL_PX) + 0.5) * CELL_PX
    return np.asarray((ROWS / 2 - middle_px) / PX_PER_RAD, dtype=float)


def directions_of(
    cell: NDArray[np.int64], rig: CameraRig
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Bearing (rad) and slope of cells that are counted row by row, (n,) each."""
    row, column = np.divmod(cell, columns_of(rig) // CELL_PX)
    return cell_bearings_rad(rig)[column], cell_slopes()[row]


def cells_at(
    bearing_rad: NDArray[np.float64], slope: NDArray[np.float64], rig: CameraRig
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The cell in each direction, counted row by row, and whether there is one: (n,) each."""
    rows, columns = ROWS // CELL_PX, columns_of(rig) // CELL_PX
    from_left = rig.span_rad / 2 - wrap_angle_rad(bearing_rad)
    column = np.floor(from_left / (rig.span_rad / columns)).astype(int)
    slopes = cell_slopes()
    row = np.round((slopes[0] - slope) / (slopes[0] - slopes[1]))
    inside = (row >= 0) & (row < rows)
    if not rig.closed:
        inside &= (column >= 0) & (column < columns)
    return row.clip(0, rows - 1).astype(int) * columns + column % columns, inside
