"""Mesh primitives, and the builder that joins them into one textured Surface.

A ``Part`` is a few faces with a uv in 0..1; a ``Model`` packs the pictures that its parts show
into one texture sheet, so that an object is one Surface. Model frame: metres, z up from 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.geometry import rotation_z
from vrchain.world.model import Surface

Image = NDArray[np.uint8]
_SHEET_PX = 560  # about as wide as a sheet gets
_MARGIN_PX = 4  # a patch's rim is repeated around it, so that small mip levels do not mix patches


class Rect(NamedTuple):
    """An upright rectangle on the ground, metres."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def width_m(self) -> float:
        return self.x1 - self.x0

    @property
    def depth_m(self) -> float:
        return self.y1 - self.y0

    @property
    def middle_x_m(self) -> float:
        return (self.x0 + self.x1) / 2

    def shifted(self, dx: float, dy: float) -> "Rect":
        return Rect(self.x0 + dx, self.y0 + dy, self.x1 + dx, self.y1 + dy)

    def grown(self, rim_m: float) -> "Rect":
        return Rect(self.x0 - rim_m, self.y0 - rim_m, self.x1 + rim_m, self.y1 + rim_m)

    def side(self, name: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ends of side f (-y), b (+y), l (-x) or r (+x), left to right as seen from outside."""
        x0, y0, x1, y1 = self
        corners = ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))
        first = "frbl".index(name)
        return corners[first], corners[first + 1]


@dataclass(frozen=True, eq=False)
class Part:
    """points: (n, 3) m; faces: (k, 3) indices, anticlockwise from outside; uv: (n, 2) in 0..1."""

    points: NDArray[np.float64]
    faces: NDArray[np.int64]
    uv: NDArray[np.float64]

    def moved(self, offset_m: ArrayLike = (0, 0, 0), yaw_rad: float = 0.0) -> "Part":
        """The part turned about z, then shifted."""
        return replace(self, points=self.points @ rotation_z(yaw_rad).T + np.asarray(offset_m))


def join(parts: Sequence[Part]) -> Part:
    """One part of several that show the same patch."""
    first = np.cumsum([0, *(len(p.points) for p in parts[:-1])])
    return Part(
        np.concatenate([p.points for p in parts]),
        np.concatenate([p.faces + n for p, n in zip(parts, first, strict=True)]),
        np.concatenate([p.uv for p in parts]),
    )


def polygon(corners: ArrayLike, uv: ArrayLike | None = None) -> Part:
    """A convex polygon, corners (n, 3) anticlockwise from outside; four show the whole patch."""
    points = np.asarray(corners, dtype=float)
    n = len(points)
    fan = np.array([(0, i, i + 1) for i in range(1, n - 1)])
    if uv is None:
        uv = [(0, 0), (1, 0), (1, 1), (0, 1)] if n == 4 else np.full((n, 2), 0.5)
    return Part(points, fan, np.asarray(uv, dtype=float))


def wall(start_xy: ArrayLike, end_xy: ArrayLike, bottom_m: float, top_m: float) -> Part:
    """An upright rectangle, seen from the right of start -> end; start is the picture's left."""
    (x0, y0), (x1, y1) = np.asarray(start_xy, dtype=float), np.asarray(end_xy, dtype=float)
    return polygon([(x0, y0, bottom_m), (x1, y1, bottom_m), (x1, y1, top_m), (x0, y0, top_m)])


def box(
    low: ArrayLike, high: ArrayLike, *, bottom: bool = False, top: bool = True, sides: str = "fblr"
) -> Part:
    """An upright box between two corners; sides f (-y), b (+y), l (-x), r (+x)."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    parts = [wall(*Rect(x0, y0, x1, y1).side(s), z0, z1) for s in sides]
    if top:
        parts.append(polygon([(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)]))
    if bottom:
        parts.append(polygon([(x0, y1, z0), (x1, y1, z0), (x1, y0, z0), (x0, y0, z0)]))
    return join(parts)


def grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """Triangles (k, 3) between points in rows, anticlockwise where rows go upwards."""
    low = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    high = low + columns
    return np.concatenate(
        [np.stack([low, low + 1, high + 1], 1), np.stack([low, high + 1, high], 1)]
    )


def sphere(turn_rad: NDArray[np.float64], tilt_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors (..., 3) at azimuths from +x, and at elevations."""
    flat = np.cos(tilt_rad)
    return np.stack(
        [flat * np.cos(turn_rad), flat * np.sin(turn_rad), np.sin(tilt_rad) + 0 * turn_rad], axis=-1
    )


def tube(
    start: ArrayLike,
    end: ArrayLike,
    radius_m: float,
    end_radius_m: float | None = None,
    n: int = 8,
    *,
    cap: bool = False,
) -> Part:
    """A round rod, or a cone for ``end_radius_m`` 0; u runs around, v from start to end."""
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    axis = (b - a) / np.linalg.norm(b - a)
    helper = np.array([1.0, 0.0, 0.0]) if abs(axis[2]) > 0.9 else np.array([0.0, 0.0, 1.0])
    side = np.cross(axis, helper)
    side /= np.linalg.norm(side)
    turn = np.linspace(0, 2 * np.pi, n + 1)[:, None]
    ring = np.cos(turn) * side + np.sin(turn) * np.cross(axis, side)
    far = radius_m if end_radius_m is None else end_radius_m
    points = np.concatenate([a + radius_m * ring, b + far * ring])
    u = np.linspace(0, 1, n + 1)
    uv = np.stack([np.tile(u, 2), np.repeat([0.0, 1.0], n + 1)], axis=1)
    parts = [Part(points, grid_faces(2, n + 1), uv)]
    if cap:
        disc = 0.5 + 0.5 * np.concatenate([np.cos(turn), np.sin(turn)], axis=1)[:-1]
        parts.append(polygon((b + far * ring)[:-1], disc))
    return join(parts)


def blob(centre: ArrayLike, radii: ArrayLike, n: int = 10, rings: int = 7) -> Part:
    """A ball-like shape of ``rings`` levels, pole to pole, and ``n`` points around."""
    turn, tilt = np.meshgrid(
        np.linspace(0, 2 * np.pi, n + 1), np.linspace(-np.pi / 2, np.pi / 2, rings)
    )
    unit = sphere(turn, tilt).reshape(-1, 3)
    points = np.asarray(centre, dtype=float) + unit * np.asarray(radii, dtype=float)
    seam = np.arange(rings) * (n + 1)
    points[seam + n] = points[seam]  # cos(2 pi) is not exactly cos(0)
    uv = np.stack([turn / (2 * np.pi), tilt / np.pi + 0.5], axis=-1).reshape(-1, 2)
    faces = grid_faces(rings, n + 1)
    a, b, c = (points[faces[:, i]] for i in range(3))
    keep = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-9  # the poles' empty triangles
    return Part(points, faces[keep], uv)


@dataclass
class Model:
    """Parts on one texture sheet under construction.

    Its patches are all RGB, or all RGBA for a cut-out: an object of both is two models.
    """

    _patches: list[Image] = field(default_factory=list)
    _parts: list[tuple[Part, int, NDArray[np.float64]]] = field(default_factory=list)

    def patch(self, image: Image) -> int:
        """Put a picture on the sheet; its number is what ``add`` takes."""
        self._patches.append(image)
        return len(self._patches) - 1

    def add(self, part: Part, patch: int | Image, shade: float | NDArray[np.float64] = 1.0) -> None:
        """Add a part that shows a patch or a new picture; ``shade``: how open to the sky, one or
        (n,), 0..1."""
        patch = patch if isinstance(patch, int) else self.patch(patch)
        self._parts.append((part, patch, np.broadcast_to(shade, len(part.points)).astype(float)))

    def add_drum(
        self, start: ArrayLike, end: ArrayLike, radius_m: float, n: int, side: int, cap: int
    ) -> None:
        """Add a round rod that shows one patch on its side and another on its far end."""
        rod, first = tube(start, end, radius_m, n=n, cap=True), 2 * (n + 1)
        self.add(Part(rod.points[:first], rod.faces[: 2 * n], rod.uv[:first]), side)
        self.add(Part(rod.points[first:], rod.faces[2 * n :] - first, rod.uv[first:]), cap)

    def surface(self) -> Surface:
        """Everything added, as one Surface in the model's frame."""
        texture, corner, size = _pack(self._patches)
        height, width = texture.shape[:2]
        whole = join([part for part, _, _ in self._parts])
        owner = np.concatenate([np.full(len(part.points), patch) for part, patch, _ in self._parts])
        # Half a texel inside the patch at both ends: 0..1 spans texel centres.
        column = corner[owner, 0] + 0.5 + whole.uv[:, 0] * (size[owner, 0] - 1)
        row = corner[owner, 1] + 0.5 + (1 - whole.uv[:, 1]) * (size[owner, 1] - 1)
        return Surface(
            whole.points.astype(np.float32),
            whole.faces.astype(np.int32),
            np.stack([column / width, 1 - row / height], axis=1).astype(np.float32),
            np.concatenate([shade for _, _, shade in self._parts]).astype(np.float32),
            texture,
        )


def _pack(patches: Sequence[Image]) -> tuple[Image, NDArray[np.int64], NDArray[np.int64]]:
    """Pictures on one sheet: the sheet, and each picture's corner and size (x, y) in px."""
    size = np.array([(p.shape[1], p.shape[0]) for p in patches])
    padded = size + 2 * _MARGIN_PX
    least = int(padded[:, 0].max())
    tries = [
        (width, *_rows(padded, width)) for width in range(least, max(least, _SHEET_PX) + 1, 24)
    ]
    width, corner, height = min(tries, key=lambda t: t[0] * t[2] + (t[0] - t[2]) ** 2 // 64)
    sheet = np.zeros((height, width, patches[0].shape[2]), dtype=np.uint8)
    for patch, (px, py), (w, h) in zip(patches, corner, padded, strict=True):
        m = _MARGIN_PX
        sheet[py : py + h, px : px + w] = cv2.copyMakeBorder(
            patch, m, m, m, m, cv2.BORDER_REPLICATE
        )
    return sheet, corner + _MARGIN_PX, size


def _rows(sizes: NDArray[np.int64], width: int) -> tuple[NDArray[np.int64], int]:
    """Corners (x, y) of boxes set in rows within ``width``, and the height of them all."""
    corner = np.zeros_like(sizes)
    x = y = row = 0
    for i in sorted(range(len(sizes)), key=lambda i: (-sizes[i, 1], -sizes[i, 0], i)):
        w, h = (int(s) for s in sizes[i])
        if x + w > width:
            x, y, row = 0, y + row, 0
        corner[i] = x, y
        x, row = x + w, max(row, h)
    return corner, y + row
