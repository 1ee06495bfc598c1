"""Boxes, cylinders, spheres and their like, with texture coordinates as Gazebo gives them."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from vrchain.world.gazebo.materials import Look
from vrchain.world.gazebo.meshes import Part
from vrchain.world.gazebo.xml import Element

_AROUND, _RINGS = 32, 16


def build(element: Element) -> Part:
    """A primitive <box>, <cylinder>, <sphere>, <capsule>, <ellipsoid> or <cone>."""
    return _BUILDERS[element.tag](element)


def grid(points: NDArray[np.float64], uv: NDArray[np.float64]) -> Part:
    """Points on a grid, (rows, columns, 3), joined; columns run right and rows up, from outside."""
    rows, columns = points.shape[:2]
    low = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    high = low + columns
    faces = np.concatenate(
        [np.stack([low, low + 1, high + 1], 1), np.stack([low, high + 1, high], 1)]
    )
    return Part("", points.reshape(-1, 3), faces, uv.reshape(-1, 2), Look())


def plane(low: NDArray[np.float64], high: NDArray[np.float64], size: NDArray[np.float64]) -> Part:
    """A level rectangle from corner to corner, (2,); a picture spans ``size`` about the origin."""
    xy = np.array([[low, (high[0], low[1])], [(low[0], high[1]), high]])
    return grid(np.concatenate([xy, np.zeros((2, 2, 1))], axis=2), xy / size + 0.5)


def _box(element: Element) -> Part:
    half = np.array(_positive(element, "size", 3)) / 2
    corners = np.array([[(-1, -1), (1, -1)], [(-1, 1), (1, 1)]], dtype=float)
    points: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.int64]] = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            # Right and up as seen from outside: sides upright, top and bottom with y up.
            up = 1 if axis == 2 else 2
            normal, upward = np.eye(3)[axis] * side, np.eye(3)[up]
            right = np.cross(upward, normal)
            square = normal + corners[..., :1] * right + corners[..., 1:] * upward
            faces.append(np.array([[0, 1, 3], [0, 3, 2]]) + 4 * len(points))
            points.append(square.reshape(4, 3) * half)
    uv = np.tile(corners.reshape(4, 2) / 2 + 0.5, (6, 1))
    return Part("", np.concatenate(points), np.concatenate(faces), uv, Look())


def _round(radius: NDArray[np.float64], height: NDArray[np.float64]) -> Part:
    """Turned about z: radius and height of each ring, (n,), from below upwards."""
    turn = np.linspace(0, 2 * np.pi, _AROUND + 1)
    points = np.stack(
        [
            radius[:, None] * np.cos(turn),
            radius[:, None] * np.sin(turn),
            height[:, None] + 0 * turn,
        ],
        axis=-1,
    )
    along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(radius), np.diff(height)))])
    u, v = np.meshgrid(turn / (2 * np.pi), along / along[-1])
    return grid(points, np.stack([u, v], axis=-1))


def _lid(radius: float, height: float) -> Part:
    """A disc; facing down where ``height`` is negative."""
    turn = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False) * np.copysign(1, height)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.column_stack([radius * ring, np.full(_AROUND, height)])
    i = np.arange(1, _AROUND - 1)
    faces = np.stack([0 * i, i, i + 1], axis=1)
    return Part("", points, faces, ring / 2 + 0.5, Look())


def _joined(*parts: Part) -> Part:
    first = np.cumsum([0, *(len(p.vertices_m) for p in parts)])
    return Part(
        "",
        np.concatenate([p.vertices_m for p in parts]),
        np.concatenate([p.faces + n for p, n in zip(parts, first[:-1], strict=True)]),
        np.concatenate([p.uv for p in parts if p.uv is not None]),
        Look(),
    )


def _cylinder(element: Element) -> Part:
    (radius,), (length,) = _positive(element, "radius", 1), _positive(element, "length", 1)
    side = _round(np.array([radius, radius]), np.array([-length, length]) / 2)
    return _joined(side, _lid(radius, length / 2), _lid(radius, -length / 2))


def _cone(element: Element) -> Part:
    (radius,), (length,) = _positive(element, "radius", 1), _positive(element, "length", 1)
    side = _round(np.array([radius, 0.0]), np.array([-length, length]) / 2)
    return _joined(side, _lid(radius, -length / 2))


def _ball(radii: NDArray[np.float64], gap: float = 0.0) -> Part:
    """An ellipsoid, its halves ``gap`` apart, as those of a capsule."""
    tilt = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 1)
    if gap:
        tilt = np.insert(tilt, _RINGS // 2, 0.0)
    apart = np.where(np.arange(len(tilt)) > _RINGS // 2, gap / 2, -gap / 2)
    ball = _round(np.cos(tilt), np.sin(tilt))
    points = ball.vertices_m * radii
    points[:, 2] += np.repeat(apart, _AROUND + 1)
    return Part("", points, ball.faces, ball.uv, Look())


def _sphere(element: Element) -> Part:
    return _ball(np.full(3, _positive(element, "radius", 1)[0]))


def _capsule(element: Element) -> Part:
    (radius,), (length,) = _positive(element, "radius", 1), _positive(element, "length", 1)
    return _ball(np.full(3, radius), length)


def _ellipsoid(element: Element) -> Part:
    return _ball(np.array(_positive(element, "radii", 3)))


def _positive(element: Element, name: str, n: int) -> tuple[float, ...]:
    child = element.find(name)
    if child is None:
        raise element.error(f"expected a <{name}>")
    values = child.numbers(n)
    if min(values) <= 0:
        raise child.error(f"expected more than 0, got {child.text!r}")
    return values


_BUILDERS: dict[str, Callable[[Element], Part]] = {
    "box": _box,
    "cylinder": _cylinder,
    "sphere": _sphere,
    "capsule": _capsule,
    "ellipsoid": _ellipsoid,
    "cone": _cone,
}
KINDS = tuple(_BUILDERS)
