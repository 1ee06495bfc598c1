"""Triangles that look alike: of a mesh, or a box, a ball and their like, as Gazebo makes them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vrchain.world.gazebo.files import Notes
from vrchain.world.gazebo.materials import Look, Materials
from vrchain.world.gazebo.xml import Element

MOST_MESH_TRIANGLES = 2_000_000
MOST_MESH_NODES = 20_000  # every use of one counted
PRIMITIVES = ("box", "cylinder", "sphere", "capsule", "ellipsoid", "cone")
_PLAIN = Look()
_AROUND, _RINGS = 32, 16
_APART_M = 0.0015  # each to its side
# Planes are told apart by numbers rounded to these, odd so that no usual length lies between two.
_NORMAL_STEP, _PLANE_STEP_M = 0.00213, 0.000937


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles that look alike.

    vertices_m: (n, 3) float; faces: (m, 3) int, anticlockwise seen from outside; uv: (n, 2) float,
    v upwards, or None; look: the mesh's own; name: of the submesh that they are of; shade: (n, 3)
    float, colours of vertices, or None.
    """

    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]
    uv: NDArray[np.float64] | None = None
    look: Look = _PLAIN
    name: str = ""
    shade: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class MeshFile:
    """A mesh file, by the element of a world that names it."""

    file: Path
    element: Element
    materials: Materials
    notes: Notes


def moved(part: Part, matrix: NDArray[np.float64]) -> Part:
    """A part by a matrix (4, 4); what that mirrors is turned right side out again."""
    vertices = part.vertices_m @ matrix[:3, :3].T + matrix[:3, 3]
    mirrored = np.linalg.det(matrix[:3, :3]) < 0
    return replace(part, vertices_m=vertices, faces=part.faces[:, ::-1] if mirrored else part.faces)


def primitive(element: Element) -> Part:
    """One of ``PRIMITIVES``, with texture coordinates as Gazebo gives them. Raises SpecError.

    See http://sdformat.org/spec for the defaults.
    """
    if element.tag == "box":
        return _box(_positive(element, "size", (1.0, 1.0, 1.0)) / 2)
    if element.tag == "ellipsoid":
        return _ball(_positive(element, "radii", (1.0, 1.0, 1.0)))
    (radius,) = _positive(element, "radius", (0.5 if element.tag == "capsule" else 1.0,))
    if element.tag == "sphere":
        return _ball(np.full(3, radius))
    (length,) = _positive(element, "length", (1.0,))
    if element.tag == "capsule":
        return _ball(np.full(3, radius), length)
    low, high = _lid(radius, -length / 2), _lid(radius, length / 2)
    ends = np.array([-length, length]) / 2
    if element.tag == "cone":
        return joined(_round(np.array([radius, 0.0]), ends), low)
    return joined(_round(np.array([radius, radius]), ends), high, low)


def _positive(element: Element, name: str, default: tuple[float, ...]) -> NDArray[np.float64]:
    """Numbers above 0; what is not given is as the specification has it."""
    values = np.array(element.values(name, default))
    if values.min() <= 0:
        raise element.error(f"expected more than 0 in its <{name}>, got {element.words(name)!r}")
    return values


def grid(points: NDArray[np.float64], uv: NDArray[np.float64]) -> Part:
    """Points on a grid, (rows, columns, 3), joined; columns run right and rows up, from outside."""
    rows, columns = points.shape[:2]
    low = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    high = low + columns
    faces = np.concatenate(
        [np.stack([low, low + 1, high + 1], 1), np.stack([low, high + 1, high], 1)]
    )
    return Part(points.reshape(-1, 3), faces, uv.reshape(-1, 2))


def plane(low: NDArray[np.float64], high: NDArray[np.float64], size: NDArray[np.float64]) -> Part:
    """A level rectangle from corner to corner, (2,); a picture spans ``size`` about the origin."""
    xy = np.array([[low, (high[0], low[1])], [(low[0], high[1]), high]])
    return grid(np.concatenate([xy, np.zeros((2, 2, 1))], axis=2), xy / size + 0.5)


def _box(half: NDArray[np.float64]) -> Part:
    corners = np.array([[(-1, -1), (1, -1)], [(-1, 1), (1, 1)]], dtype=float)
    sides = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            # Right and up as seen from outside: sides upright, top and bottom with y up.
            normal, up = np.eye(3)[axis] * side, np.eye(3)[1 if axis == 2 else 2]
            square = normal + corners[..., :1] * np.cross(up, normal) + corners[..., 1:] * up
            sides.append(grid(square * half, corners / 2 + 0.5))
    return joined(*sides)


def _round(radius: NDArray[np.float64], height: NDArray[np.float64]) -> Part:
    """Turned about z: radius and height of each ring, (n,), from below upwards."""
    turn = np.linspace(0, 2 * np.pi, _AROUND + 1)
    x, y = radius[:, None] * np.cos(turn), radius[:, None] * np.sin(turn)
    points = np.stack(np.broadcast_arrays(x, y, height[:, None]), axis=-1)
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
    return Part(points, faces, ring / 2 + 0.5)


def _ball(radii: NDArray[np.float64], gap: float = 0.0) -> Part:
    """An ellipsoid, its halves ``gap`` apart, as those of a capsule."""
    tilt = np.linspace(-np.pi / 2, np.pi / 2, _RINGS + 1)
    if gap:
        tilt = np.insert(tilt, _RINGS // 2, 0.0)
    apart = np.where(np.arange(len(tilt)) > _RINGS // 2, gap / 2, -gap / 2)
    ball = _round(np.cos(tilt), np.sin(tilt))
    points = ball.vertices_m * radii
    points[:, 2] += np.repeat(apart, _AROUND + 1)
    return replace(ball, vertices_m=points)


def joined(*parts: Part) -> Part:
    """Parts with texture coordinates as one, in the first one's look."""
    first = np.cumsum([0, *(len(p.vertices_m) for p in parts)])
    return Part(
        np.concatenate([p.vertices_m for p in parts]),
        np.concatenate([p.faces + n for p, n in zip(parts, first[:-1], strict=True)]),
        np.concatenate([p.uv for p in parts if p.uv is not None]),
    )


def cleaned(part: Part) -> Part:
    """Without faces that have no area, or lie on another one and look the same, front or back.

    And without corners that no face uses: they would count in its size.
    """
    _, place = np.unique(part.vertices_m, axis=0, return_inverse=True)
    looks = part.vertices_m[:, :2] * 0 if part.uv is None else part.uv
    _, alike = np.unique(np.column_stack([place.ravel(), looks]), axis=0, return_inverse=True)
    corners = np.sort(place.ravel()[part.faces], axis=1)
    has_area = (np.diff(corners, axis=1) > 0).all(axis=1)
    _, first = np.unique(np.sort(alike.ravel()[part.faces], axis=1), axis=0, return_index=True)
    keep = np.zeros(len(corners), dtype=bool)
    keep[first] = True
    used, faces = np.unique(part.faces[keep & has_area], return_inverse=True)
    uv, shade = (values if values is None else values[used] for values in (part.uv, part.shade))
    return replace(
        part, vertices_m=part.vertices_m[used], faces=faces.reshape(-1, 3), uv=uv, shade=shade
    )


def apart(parts: Sequence[Part]) -> list[Part]:
    """The parts of one model, in metres, with back-to-back faces moved to their sides.

    Of these Gazebo shows the one that looks at the camera. Here all faces are drawn from both
    sides, so two in one plane that look away from each other, as the front and the back of a sign,
    would show through one another.
    """
    triangles = [part.vertices_m[part.faces] for part in parts]
    normal, backed = _backed(np.concatenate([np.empty((0, 3, 3)), *triangles]))
    ends = np.cumsum([len(of_part) for of_part in triangles], dtype=int)
    split = zip(parts, np.split(normal, ends), np.split(backed, ends), strict=False)
    return [_moved(part, n, b) for part, n, b in split]


def _backed(
    triangles: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Unit normals (n, 3) of triangles (n, 3, 3), and which share a plane with opposite ones."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    rounded = np.round(normal / _NORMAL_STEP).astype(np.int64)
    first = np.argmax(rounded != 0, axis=1)
    side = np.sign(np.take_along_axis(rounded, first[:, None], axis=1))
    plane = np.round(side[:, 0] * np.einsum("ij,ij->i", normal, a) / _PLANE_STEP_M)
    key = np.column_stack([side * rounded, np.clip(plane, -1e15, 1e15).astype(np.int64)])
    _, member = np.unique(key, axis=0, return_inverse=True)
    n = member.max(initial=-1) + 1
    ahead, behind = (np.bincount(member.ravel()[side[:, 0] == s], minlength=n) for s in (1, -1))
    return normal, ((ahead > 0) & (behind > 0))[member.ravel()]


def _moved(part: Part, normal: NDArray[np.float64], backed: NDArray[np.bool_]) -> Part:
    """A part whose ``backed`` faces, with corners of their own, are moved along their normals."""
    if not backed.any():
        return part
    moved = part.faces[backed]
    corners = moved.ravel()
    points = part.vertices_m[corners] + _APART_M * np.repeat(normal[backed], 3, axis=0)
    faces = part.faces.copy()
    faces[backed] = len(part.vertices_m) + np.arange(len(corners)).reshape(-1, 3)
    return replace(
        part,
        vertices_m=np.concatenate([part.vertices_m, points]),
        faces=faces,
        uv=None if part.uv is None else np.concatenate([part.uv, part.uv[corners]]),
        shade=None if part.shade is None else np.concatenate([part.shade, part.shade[corners]]),
    )
