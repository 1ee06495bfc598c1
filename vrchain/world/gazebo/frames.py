"""Poses, and the frames that they are given in.

Poses are x y z roll pitch yaw, turns about fixed axes; they compose from the visual outwards.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import rotation_z
from vrchain.world.gazebo.limits import FARTHEST_M
from vrchain.world.gazebo.xml import Element

Matrix = NDArray[np.float64]
_FRAMED = ("link", "model", "include", "frame", "joint")


def pose_matrix(element: Element | None) -> Matrix:
    """A <pose> as (4, 4); the identity where there is none."""
    matrix = np.eye(4)
    if element is None or not element.text:
        return matrix
    if element.attributes.get("rotation_format", "euler_rpy") == "quat_xyzw":
        x_m, y_m, z_m, *quaternion = element.numbers(7)
        matrix[:3, :3] = _of_quaternion(np.array(quaternion), element)
    else:
        x_m, y_m, z_m, *angles = element.numbers(6)
        scale = np.pi / 180 if element.attributes.get("degrees") in ("true", "1") else 1.0
        roll, pitch, yaw = (scale * a for a in angles)
        matrix[:3, :3] = rotation_z(yaw) @ _rotation_y(pitch) @ _rotation_x(roll)
    if max(abs(x_m), abs(y_m), abs(z_m)) >= FARTHEST_M:
        raise element.error(
            f"expected a place within {FARTHEST_M / 1000:g} km, this is farther away: "
            f"{element.text[:60]!r}"
        )
    matrix[:3, 3] = x_m, y_m, z_m
    return matrix


def _rotation_x(angle_rad: float) -> Matrix:
    return np.roll(rotation_z(angle_rad), 1, axis=(0, 1))


def _rotation_y(angle_rad: float) -> Matrix:
    return np.roll(rotation_z(angle_rad), 2, axis=(0, 1))


def _of_quaternion(xyzw: Matrix, element: Element) -> Matrix:
    norm = float(np.linalg.norm(xyzw))
    if not norm > 1e-9:
        raise element.error("expected a quaternion, got one of length 0")
    x, y, z, w = xyzw / norm
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


@dataclass(frozen=True)
class Inner:
    """A model as the frames around it see it: its name, its own pose, and the frames within it."""

    name: str
    pose: Matrix
    frames: "Frames"


class Frames:
    """Poses of what a world or model holds, in its frame, by ``relative_to`` where given."""

    def __init__(self, scope: Element, own: str, placed: dict[int, Inner]) -> None:
        self._scope, self._own = scope, own
        self._placed = placed
        self._elements: dict[str, Element] = {}
        for element in scope.all(*_FRAMED):
            known = placed.get(id(element))
            name = name_of(element, known.name if known else "")
            if name:
                self._elements.setdefault(name, element)

    def of(self, element: Element, default: Matrix | None = None) -> Matrix:
        """Pose of a child of the scope; ``default`` is a model's own, where none is given."""
        return self._pose(element, default, ())

    def find(self, name: str) -> Matrix | None:
        """Pose of what has a name in the scope, None if nothing has."""
        element = self._elements.get(name)
        return None if element is None else self._named(name, element, ())

    def of_visual(self, visual: Element, link: Matrix) -> Matrix:
        """Pose of a visual, whose link has a known one."""
        pose = visual.find("pose")
        given = pose.attributes.get("relative_to", "") if pose is not None else ""
        return (self._named(given, visual, ()) if given else link) @ pose_matrix(pose)

    def _pose(self, element: Element, default: Matrix | None, seen: tuple[str, ...]) -> Matrix:
        pose = element.find("pose")
        if pose is None and default is not None:
            return default
        given = pose.attributes.get("relative_to", "") if pose is not None else ""
        if not given and element.tag == "frame":
            given = element.attributes.get("attached_to", "")
        if not given and element.tag == "joint":
            given = element.words("child")
        base = self._named(given, element, seen) if given else np.eye(4)
        return base @ pose_matrix(pose)

    def _named(self, name: str, user: Element, seen: tuple[str, ...]) -> Matrix:
        if name in (self._own, "world", "__model__"):
            return np.eye(4)
        if name in seen or len(seen) > 64:
            raise user.error(f"its pose depends on itself: {' -> '.join((*seen, name))[:200]}")
        element = self._elements.get(name)
        first, _, within = name.partition("::")
        if element is None and within:
            element = self._elements.get(first)
        known = self._placed.get(id(element))
        if element is None or (within and known is None):
            raise user.error(f"there is no frame {name[:80]!r} in <{self._scope.tag}>")
        matrix = self._pose(element, known.pose if known else None, (*seen, name))
        return matrix @ known.frames._named(within, user, ()) if known and within else matrix


def name_of(element: Element, otherwise: str) -> str:
    if element.tag == "include":
        return element.words("name") or otherwise
    return element.attributes.get("name", "") or otherwise
