"""A world's ground: of all planes that are level and wide the lowest, and hills of heightmaps."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vrchain.world.gazebo.frames import Matrix, Model, Placed, Visual, cross_matrix
from vrchain.world.gazebo.materials import Look
from vrchain.world.gazebo.parts import Part, grid
from vrchain.world.gazebo.xml import Element

WIDE_M = 40.0  # a narrower plane is a thing of its own
ELEVATIONS = (".tif", ".tiff", ".dem", ".asc", ".hgt", ".nc")  # metres, not greys
_MOST_POINTS = 129  # a side; a finer picture is thinned out

_Plane = tuple[Matrix, float, Element]  # where it lies, its area in m2, its <visual>


def visual_of(placed: Iterable[Placed]) -> Element | None:
    """The <visual> that shows the ground; None if there is none. The largest of the lowest."""
    found: list[_Plane] = []
    lowest: dict[Model, _Plane | None] = {}  # of each, in its frame
    for thing in placed:
        model = thing.model
        if model not in lowest:
            level = _level(model.all_visuals(np.eye(4)))
            lowest[model] = min(level, key=_lowest_first, default=None)
        if (plane := lowest[model]) is not None:
            matrix = thing.matrix @ plane[0]
            if _is_level(matrix):
                found.append((matrix, *plane[1:]))
    return min(found, key=_lowest_first)[2] if found else None


def is_wide(visual: Visual) -> bool:
    """Whether this is a plane as wide as ground."""
    return _wide_plane(visual) is not None


def _wide_plane(visual: Visual) -> Element | None:
    """The first shape of a visual's first geometry, if it is such a plane."""
    shown = visual.element.find("geometry")
    first = next(iter(shown.children), None) if shown is not None else None
    if first is None or first.tag != "plane" or plane_of(first)[1].min() < WIDE_M:
        return None
    return first


def plane_of(shape: Element) -> tuple[Matrix, NDArray[np.float64]]:
    """Of a <plane> the turn that brings z to its normal, (4, 4), and its size, (2,)."""
    size_m = np.array(shape.values("size", (1.0, 1.0)))
    up = np.array(shape.values("normal", (0.0, 0.0, 1.0)))
    length = float(np.linalg.norm(up))
    if size_m.min() <= 0 or not 1e-9 < length < np.inf:
        raise shape.error("expected a size and a normal longer than 0")
    return _towards(up / length), size_m


def level_m(matrix: Matrix) -> float:
    """The height of a plane, without the noise of sums, as a vertex has it."""
    return float(np.float32(round(float(matrix[2, 3]), 4)))


def depth(matrix: Matrix) -> tuple[bool, float]:
    """Less for a lower plane, and least for those that are level."""
    return not _is_level(matrix), level_m(matrix)


def layers_of(shape: Element) -> list[tuple[Element, float]]:
    """The <texture> of each layer of a <heightmap>, and from which height it lies, in metres."""
    blends = [blend.number("min_height", 0.0) for blend in shape.all("blend")]
    return list(zip(shape.all("texture"), [-np.inf, *blends], strict=False))


def terrain(
    shape: Element, heights: NDArray[np.uint8], layers: Sequence[tuple[float, Look, float]]
) -> list[Part]:
    """Parts of a <heightmap>, about its world's origin.

    heights: (rows, columns), its first row in the north. layers: of each how wide its picture is
    laid, in metres, its look, and from which height it lies. White is as high as the <size>.
    """
    wide_m, long_m, high_m = shape.values("size", (1.0, 1.0, 1.0))
    if min(wide_m, long_m, *(laid_m for laid_m, *_ in layers)) <= 0 or high_m < 0:
        raise shape.error("expected sizes above 0, of the heightmap and of its textures")
    if min(heights.shape) < 2:
        raise shape.error("expected a picture of 2 x 2 pixels or more")
    rows, columns = (
        np.round(np.linspace(0, n - 1, min(n, _MOST_POINTS))).astype(int) for n in heights.shape
    )
    z = heights[np.ix_(rows[::-1], columns)] / 255 * high_m
    x, y = np.meshgrid(wide_m * (columns / columns[-1] - 0.5), long_m * (rows / rows[-1] - 0.5))
    points = np.stack([x, y, z], axis=2)
    whole = grid(points, points[..., :2])
    middle_m = z.ravel()[whole.faces].mean(axis=1)
    layer = np.searchsorted([from_m for *_, from_m in layers], middle_m, side="right") - 1
    at = np.array(shape.values("pos", (0.0, 0.0, 0.0)))
    assert whole.uv is not None
    return [
        replace(
            whole, vertices_m=whole.vertices_m + at, faces=whole.faces[layer == k],
            uv=whole.uv / laid_m, look=look,
        )
        for k, (laid_m, look, _) in enumerate(layers)
        if (layer == k).any()
    ]  # fmt: skip


def _level(visuals: Iterable[Visual]) -> Iterator[_Plane]:
    """Those visuals that could be ground."""
    for visual in visuals:
        plane = _wide_plane(visual)
        if plane is not None and visual.element.number("transparency", 0.0) < 0.5:
            turn, size_m = plane_of(plane)
            if _is_level(visual.matrix @ turn):
                yield visual.matrix @ turn, float(size_m.prod()), visual.element


def _lowest_first(plane: _Plane) -> tuple[float, float]:
    matrix, area_m2, _ = plane
    return float(matrix[2, 3]), -area_m2


def _is_level(matrix: Matrix) -> bool:
    return bool(matrix[2, 2] > 1 - 1e-6)


def _towards(normal: NDArray[np.float64]) -> Matrix:
    """The least turn that brings z to a unit normal, (4, 4)."""
    matrix = np.eye(4)
    axis = np.cross((0.0, 0.0, 1.0), normal)
    if not axis.any():
        matrix[:3, :3] = np.diag([1.0, np.sign(normal[2]), np.sign(normal[2])])
        return matrix
    cross = cross_matrix(axis)
    matrix[:3, :3] += cross + cross @ cross / (1 + normal[2])
    return matrix
