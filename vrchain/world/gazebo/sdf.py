"""SDF documents: which models a world places where, and the visuals of each.

See http://sdformat.org/spec.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vrchain.world.gazebo.files import VARIABLES, Folders, is_file, read_bytes
from vrchain.world.gazebo.frames import Frames, Inner, Matrix, name_of, pose_matrix
from vrchain.world.gazebo.limits import MOST_INCLUDES_DEEP, MOST_MODELS, MOST_XML_BYTES
from vrchain.world.gazebo.notes import Notes
from vrchain.world.gazebo.xml import Element, parse

# What may stand in a world, model or link and is not drawn, and how the warning calls it.
_UNSUPPORTED = {
    "plugin": "plugins",
    "fog": "fog",
    "actor": "actors",
    "population": "populations",
    "road": "roads of lines",
    "light": "lights beside the sun",
    "sensor": "sensors",
    "projector": "projectors",
    "particle_emitter": "particle emitters",
    "experimental:params": "parameters of includes",
}


@dataclass(frozen=True, eq=False)
class Visual:
    """Something to be drawn. matrix: (4, 4) from its frame to its model's."""

    element: Element
    matrix: Matrix


@dataclass(frozen=True, eq=False)
class Model:
    """A model as its file has it: its own pose, its visuals, and models within it.

    count: of models, itself and those within it, and within these. ours: what a world of our own
    says of it.
    """

    name: str
    pose: Matrix
    visuals: tuple[Visual, ...]
    nested: tuple["Placed", ...]
    design: str  # the folder's name if it has one, else its own
    count: int
    ours: Element | None
    frames: Frames


@dataclass(frozen=True, eq=False)
class Placed:
    """A model in a world or in another model. matrix: (4, 4) from its frame to that one's."""

    name: str
    model: Model
    matrix: Matrix
    element: Element


_Light = tuple[Element, Element | None]  # a <light>, and the <pose> it has


@dataclass(frozen=True, eq=False)
class World:
    """What a file holds. sun: (3,) the way that its light goes; None if there is no sun.

    ours: what a world of our own says of its season and light.
    """

    name: str
    models: tuple[Placed, ...]
    sun: Matrix | None
    ours: Element | None


def read_world(path: Path, folders: Folders, notes: Notes) -> World:
    """The world of a file, or its one model as a world. Raises SpecError."""
    return _Reader(folders, notes).world(path)


class _Reader:
    """Reads a world's files, each of them once."""

    def __init__(self, folders: Folders, notes: Notes) -> None:
        self._folders, self._notes = folders, notes
        self._models: dict[Path, Model | Element] = {}
        self._open: list[Path] = []  # files that include one another, the world first
        self._deep = 0  # models in one another, where it reads

    def world(self, path: Path) -> World:
        root = self._document(path)
        worlds = list(root.all("world"))
        if len(worlds) > 1:
            names = ", ".join(w.attributes.get("name", "") for w in worlds[1:])
            self._notes.add("worlds after the file's first", names)
        scope = worlds[0] if worlds else root
        if not worlds and root.find("model") is None:
            raise root.error("expected a <world> or a <model> in it")
        self._open.append(path.resolve())
        lights = [(light, light.find("pose")) for light in scope.all("light")]
        models = list(self._placed(scope, "world", lights))
        self._unsupported(scope, lights=False)
        for inside, kinds in (("gui", ("plugin",)), ("scene", ("fog",))):
            for element in scope.all(inside):
                self._unsupported(element, only=kinds)
        return World(
            scope.attributes.get("name", path.stem),
            tuple(_as_saved(models, scope, self._notes)),
            self._sun(lights),
            scope.find("vrchain:scene"),
        )

    def _document(self, path: Path) -> Element:
        root = parse(read_bytes(path, MOST_XML_BYTES), path)
        if root.tag not in ("sdf", "gazebo"):
            raise root.error("expected <sdf> as the document's root")
        return root

    def _placed(self, scope: Element, frame: str, lights: list[_Light]) -> Iterator[Placed]:
        """The models of a world or model, with their frames resolved; its lights are added."""
        own: dict[int, Model] = {}
        for element in scope.all("model", "include"):
            found = self._model(element) if element.tag == "model" else self._included(element)
            if isinstance(found, Element):
                if found.tag == "light":
                    pose = element.find("pose")
                    lights.append((found, found.find("pose") if pose is None else pose))
                else:
                    self._notes.add(_UNSUPPORTED.get(found.tag, found.tag), found.file.parent.name)
                continue
            own[id(element)] = found
        inner = {k: Inner(m.name, m.pose, m.frames) for k, m in own.items()}
        frames = Frames(scope, frame, inner)
        if sum(model.count for model in own.values()) > MOST_MODELS:
            raise scope.error(f"expected at most {MOST_MODELS} models, in includes as well")
        for element in scope.all("model", "include"):
            model = own.get(id(element))
            if model is not None:
                name = name_of(element, model.name)
                yield Placed(name, model, frames.of(element, model.pose), element)

    def _model(self, element: Element, design: str | None = None) -> Model:
        self._deep += 1
        if self._deep > MOST_INCLUDES_DEEP:
            raise element.error(f"models lie more than {MOST_INCLUDES_DEEP} deep in one another")
        self._unsupported(element)
        for joint in element.all("joint"):
            if joint.attributes.get("type") != "fixed":
                self._notes.add("joints that move", joint.attributes.get("name", ""))
        name = element.attributes.get("name", "") or element.file.parent.name
        lights: list[_Light] = []
        nested = tuple(self._placed(element, "__model__", lights))
        for _ in lights:
            self._notes.add(_UNSUPPORTED["light"], name)
        inner = {id(p.element): Inner(p.name, p.model.pose, p.model.frames) for p in nested}
        frames = Frames(element, "__model__", inner)
        visuals = []
        for link in element.all("link"):
            self._unsupported(link)
            matrix = frames.of(link)
            for visual in link.all("visual"):
                self._unsupported(visual)
                visuals.append(Visual(visual, frames.of_visual(visual, matrix)))
        self._deep -= 1
        pose = pose_matrix(element.find("pose"))
        count = 1 + sum(p.model.count for p in nested)
        ours = element.find("vrchain:object")
        return Model(name, pose, tuple(visuals), nested, design or name, count, ours, frames)

    def _included(self, include: Element) -> Model | Element:
        """The model of an <include>; or the element of what else it holds, such as a light."""
        self._unsupported(include)
        file = self._model_file(include)
        if file in self._open:
            circle = " -> ".join(str(f.name) for f in (*self._open, file))
            raise include.error(f"{include.words('uri')} includes itself: {circle}")
        if include.find("placement_frame") is not None:
            self._notes.add("placement frames", include.words("placement_frame"))
        if file not in self._models:
            self._open.append(file)
            root = self._document(file)
            found = root.find("model")
            if found is not None:
                in_folder = file.parent in self._folders.models
                design = file.stem if in_folder else file.parent.name
                self._models[file] = self._model(found, design)
            else:
                others = list(root.all("light", "actor"))
                if not others:
                    raise root.error("expected a <model> in it")
                self._models[file] = others[0]
            self._open.pop()
        return self._models[file]

    def _model_file(self, include: Element) -> Path:
        uri = include.words("uri")
        if not uri:
            raise include.error("expected a <uri>")
        found = self._folders.find(uri, include.file.parent, include)
        if found is None:
            raise include.error(
                f"no model {uri[:200]!r} in the folders searched ({self._folders}): "
                f"name its folder's parent in {VARIABLES[0]} or {VARIABLES[1]}"
            )
        if is_file(found):
            return found
        config = found / "model.config"
        named = "model.sdf"
        if is_file(config):
            listed = list(parse(read_bytes(config, MOST_XML_BYTES), config).all("sdf"))
            if listed:
                named = max(listed, key=_version).text
        file = self._folders.find(named, found, include)
        if file is None or not is_file(file):
            raise include.error(f"the model {uri!r} has no file {named!r} in {found}")
        return file

    def _unsupported(
        self, scope: Element, *, lights: bool = True, only: Iterable[str] = _UNSUPPORTED
    ) -> None:
        name = scope.attributes.get("name", "")
        if scope.attributes.get("placement_frame"):
            self._notes.add("placement frames", name)
        pose = scope.find("pose")
        if pose is not None and pose.attributes.get("frame"):
            self._notes.add("frames of poses, as of SDF 1.5", pose.attributes["frame"])
        for element in scope.all(*only):
            if lights or element.tag != "light":
                name = element.attributes.get("filename") or element.attributes.get("name", "")
                self._notes.add(_UNSUPPORTED[element.tag], name)

    def _sun(self, lights: Iterable[_Light]) -> Matrix | None:
        """The direction of the first directional light; the others are noted."""
        sun = None
        for light, pose in lights:
            if sun is None and light.attributes.get("type") == "directional":
                given = light.values("direction", (0.0, 0.0, -1.0))
                turned = pose_matrix(pose)[:3, :3] @ np.array(given)
                length = float(np.linalg.norm(turned))
                if not length > 1e-9:
                    raise light.error("expected a <direction>, got one of length 0")
                sun = turned / length
            else:
                self._notes.add(_UNSUPPORTED["light"], light.attributes.get("name", ""))
        return sun


def _version(sdf: Element) -> tuple[int, ...]:
    words = sdf.attributes.get("version", "0").split(".")
    return tuple(int(word) if word.isdigit() else 0 for word in words)


def _as_saved(models: list[Placed], scope: Element, notes: Notes) -> Iterator[Placed]:
    """The models where a saved <state> has put them."""
    state = scope.find("state")
    saved: dict[str, Element] = {}
    for element in state.all("model") if state is not None else ():
        saved[element.attributes.get("name", "")] = element
    deleted = [
        name.text for part in (state.all("deletions") if state else ()) for name in part.all("name")
    ]
    for placed in models:
        if placed.name in deleted:
            continue
        where = saved.get(placed.name)
        matrix = placed.matrix
        if where is not None:
            matrix = pose_matrix(where.find("pose"))
            if where.values("scale", (1.0, 1.0, 1.0)) != (1.0, 1.0, 1.0):
                notes.add("scales of a saved state", placed.name)
            for part in where.all("link", "model"):
                if _is_moved(part, placed.model, matrix):
                    notes.add("parts that a saved state moves in their model", placed.name)
        yield Placed(placed.name, placed.model, matrix, placed.element)
    if state is not None and state.find("insertions/model") is not None:
        notes.add("models inserted in a saved state")


def _is_moved(saved: Element, model: Model, matrix: Matrix) -> bool:
    """Whether a saved part of a model, placed by a matrix, is elsewhere than in the model's file.

    Gazebo saves poses in the world, SDF has them in the model.
    """
    known = model.frames.find(saved.attributes.get("name", ""))
    if known is None or saved.find("pose") is None:
        return False
    pose = pose_matrix(saved.find("pose"))
    return not any(np.allclose(pose, at, atol=0.01) for at in (known, matrix @ known))


def flat(placed: Placed, outer: Matrix, prefix: str = "") -> Iterator[Placed]:
    """A placed model as the objects it stands for, with their names and matrices in the world.

    A model with visuals of its own is one object, with all that lies within it. One without, a mere
    group, is as many objects as there are in it, named with their group's name before ``::``.
    """
    matrix = outer @ placed.matrix
    name = prefix + placed.name
    if placed.model.visuals:
        yield Placed(name, placed.model, matrix, placed.element)
        return
    for part in placed.model.nested:
        yield from flat(part, matrix, f"{name}::")


def all_visuals(model: Model, matrix: Matrix) -> Iterator[Visual]:
    """The visuals of a model and of all models within it, with matrices to its frame."""
    for visual in model.visuals:
        yield Visual(visual.element, matrix @ visual.matrix)
    for part in model.nested:
        yield from all_visuals(part.model, matrix @ part.matrix)
