"""Which plane of a world is its ground: of all that are level and wide, the lowest."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from vrchain.world.gazebo.frames import Matrix, Model, Placed, Visual, cross_matrix
from vrchain.world.gazebo.xml import Element

_WIDE_M = 40.0  # a narrower plane is a thing of its own

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
    shape = visual.element.find("geometry/plane")
    return shape is not None and bool(plane_of(shape)[1].min() >= _WIDE_M)


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


def _level(visuals: Iterable[Visual]) -> Iterator[_Plane]:
    """Those visuals that could be ground."""
    for visual in visuals:
        if is_wide(visual) and visual.element.number("transparency", 0.0) < 0.5:
            turn, size_m = plane_of(next(visual.element.all("geometry")).children[0])
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
