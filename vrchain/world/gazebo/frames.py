"""Models, what they hold, and where: poses, and the frames that they are given in.

Poses are x y z roll pitch yaw, turns about fixed axes; they compose from the visual outwards.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import rotation_z
from vrchain.world.gazebo.xml import Element

Matrix = NDArray[np.float64]
FARTHEST_M = 1e5  # of any place from the origin; what lies farther away is left out
_FRAMED = ("link", "model", "include", "frame", "joint")


@dataclass(frozen=True, eq=False)
class Visual:
    """Something to be drawn. matrix: (4, 4) from its frame to its model's."""

    element: Element
    matrix: Matrix


@dataclass(frozen=True, eq=False)
class Model:
    """A model as its file has it: its own pose, its visuals, and models within it.

    count: of models, itself and those within it, and within these. ours: what a world of our own
    says of it. placement: the frame that its pose places, "" for its own.
    """

    name: str
    pose: Matrix
    visuals: tuple[Visual, ...]
    nested: tuple["Placed", ...]
    design: str  # the folder's name if it has one, else its own
    count: int
    ours: Element | None
    frames: "Frames"
    placement: str = ""

    def all_visuals(self, matrix: Matrix) -> Iterator[Visual]:
        """Its visuals and those of all models within it, by ``matrix`` from its frame."""
        for visual in self.visuals:
            yield Visual(visual.element, matrix @ visual.matrix)
        for part in self.nested:
            yield from part.model.all_visuals(matrix @ part.matrix)


@dataclass(frozen=True, eq=False)
class Placed:
    """A model in a world or in another model. matrix: (4, 4) from its frame to that one's."""

    name: str
    model: Model
    matrix: Matrix
    element: Element

    def flat(self, outer: Matrix, prefix: str = "") -> Iterator["Placed"]:
        """The objects it stands for, with their names and matrices in the world.

        A model with visuals of its own is one object, with all that lies within it. One without, a
        mere group, is as many objects as there are in it, named with their group's name before
        ``::``.
        """
        matrix, name = outer @ self.matrix, prefix + self.name
        if self.model.visuals:
            yield replace(self, name=name, matrix=matrix)
            return
        for part in self.model.nested:
            yield from part.flat(matrix, f"{name}::")


def pose_matrix(element: Element | None) -> Matrix:
    """A <pose> as (4, 4); the identity where there is none."""
    matrix = np.eye(4)
    if element is None or not element.text:
        return matrix
    if element.attributes.get("rotation_format", "euler_rpy") == "quat_xyzw":
        x_m, y_m, z_m, *xyzw = element.numbers(7)
        norm = float(np.linalg.norm(xyzw))
        if not norm > 1e-9:
            raise element.error("expected a quaternion, got one of length 0")
        *axis, w = np.array(xyzw) / norm
        cross = cross_matrix(axis)
        matrix[:3, :3] = np.eye(3) + 2 * w * cross + 2 * cross @ cross
    else:
        x_m, y_m, z_m, *angles = element.numbers(6)
        scale = np.pi / 180 if element.attributes.get("degrees") in ("true", "1") else 1.0
        # A turn about z is one about x or y once the axes change places.
        roll, pitch, yaw = (
            np.roll(rotation_z(scale * angle), shift, axis=(0, 1))
            for angle, shift in zip(angles, (1, 2, 0), strict=True)
        )
        matrix[:3, :3] = yaw @ pitch @ roll
    # What lies too far away is left out; until then, sums stay finite.
    matrix[:3, 3] = np.clip((x_m, y_m, z_m), -1e9, 1e9)
    return matrix


def cross_matrix(vector: Matrix | list[float]) -> Matrix:
    """The matrix (3, 3) that multiplies as the cross product by a vector (3,) does."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


class Frames:
    """Poses of what a world or model holds, in its frame, by ``relative_to`` where given."""

    def __init__(self, scope: Element, models: Mapping[Element, Model]) -> None:
        """models: what the scope's <model> and <include> elements stand for."""
        self._scope, self._models = scope, models
        self._elements: dict[str, Element] = {}
        for element in scope.all(*_FRAMED):
            known = models.get(element)
            name = name_of(element, known.name if known else "")
            if name:
                self._elements.setdefault(name, element)

    def of(
        self,
        element: Element,
        default: Matrix | None = None,
        outer: Matrix | None = None,
        seen: tuple[str, ...] = (),
    ) -> Matrix:
        """Pose of a child of the scope, or of a visual whose link has the pose ``outer``.

        default: a model's own, where none is given; seen: the names whose poses depend on this one.
        """
        pose = element.find("pose")
        model = self._models.get(element)
        if model is not None:
            placement = element.words("placement_frame") or model.placement
            if placement:
                placed = np.linalg.inv(model.frames._named(placement, element, ()))
                return self._posed(element, pose, default, outer, seen) @ placed
        return self._posed(element, pose, default, outer, seen)

    def _posed(
        self,
        element: Element,
        pose: Element | None,
        default: Matrix | None,
        outer: Matrix | None,
        seen: tuple[str, ...],
    ) -> Matrix:
        if pose is None and default is not None:
            return default
        base = pose.attributes.get("relative_to", "") if pose is not None else ""
        if not base and element.tag == "frame":
            base = element.attributes.get("attached_to", "")
        if not base and element.tag == "joint":
            base = element.words("child")
        if base:
            outer = self._named(base, element, seen)
        return (np.eye(4) if outer is None else outer) @ pose_matrix(pose)

    def find(self, name: str) -> Matrix | None:
        """Pose of what has a name in the scope, None if nothing has."""
        element = self._elements.get(name)
        return None if element is None else self._named(name, element, ())

    def _named(self, name: str, user: Element, seen: tuple[str, ...]) -> Matrix:
        if name in ("world", "__model__"):
            return np.eye(4)
        if name in seen or len(seen) > 64:
            raise user.error(f"its pose depends on itself: {' -> '.join((*seen, name))[:200]}")
        element = self._elements.get(name)
        # Gazebo classic flattened nested models: "door::link" may be a link's own name.
        first, _, within = (name, "", "") if element is not None else name.partition("::")
        if first not in self._elements:  # what a merged model holds is the scope's own
            for merged, part in self._models.items():
                if is_merged(merged) and first in part.frames._elements:
                    at = self.of(merged, part.pose, seen=(*seen, name))
                    return at @ part.frames._named(name, user, ())
        if element is None and within:
            element = self._elements.get(first)
        model = None if element is None else self._models.get(element)
        if element is None or (within and model is None):
            raise user.error(f"there is no frame {name[:80]!r} in <{self._scope.tag}>")
        matrix = self.of(element, model.pose if model else None, seen=(*seen, name))
        return matrix @ model.frames._named(within, user, ()) if model and within else matrix


def is_merged(element: Element) -> bool:
    """Whether an <include> makes its model's parts those of the model that it stands in."""
    return element.tag == "include" and element.attributes.get("merge") in ("true", "1")


def name_of(element: Element, otherwise: str) -> str:
    """The name of a child of a world or model, or of what an <include> brings."""
    if element.tag == "include":
        return element.words("name") or otherwise
    return element.name or otherwise
