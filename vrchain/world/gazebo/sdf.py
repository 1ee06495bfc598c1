"""SDF documents: which models a world places where, and the visuals of each.

See http://sdformat.org/spec.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vrchain.world.gazebo.files import Folders, Notes, is_file, read_bytes
from vrchain.world.gazebo.frames import (
    Frames,
    Matrix,
    Model,
    Placed,
    Visual,
    is_merged,
    name_of,
    pose_matrix,
)
from vrchain.world.gazebo.population import spread
from vrchain.world.gazebo.xml import MOST_XML_BYTES, Element, parse

MOST_INCLUDES_DEEP = 16
MOST_MODELS = 10_000  # placed in a world
# What may stand in a world, model or link and is not drawn, and how the warning calls it.
_UNSUPPORTED = {
    "plugin": "plugins", "fog": "fog", "actor": "actors", "light": "lights beside the sun",
    "sensor": "sensors", "projector": "projectors", "particle_emitter": "particle emitters",
    "experimental:params": "parameters of includes",
}  # fmt: skip
_AMBIENT = 0.4  # the specification's
_LAMPS, _LAMPLIT = 0.5, 0.8  # of a lamp's light what faces get, whichever way they look; at most
_Light = tuple[Element, Element | None]  # a <light>, and the <pose> it has


@dataclass(frozen=True, eq=False)
class World:
    """What a file holds. sun: (3,) the way that its light goes; None if there is no sun.

    ambient: the brightness of what no light falls on, 0..1; 0 in a world with a sun that does not
    say it, as the sky's light reaches nearly all outdoors.
    ours: what a world of our own says of its season and light.
    """

    name: str
    models: tuple[Placed, ...]
    sun: Matrix | None
    ambient: float
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
            names = ", ".join(w.name for w in worlds[1:])
            self._notes.add("worlds after the file's first", names)
        scope = worlds[0] if worlds else root
        if not worlds and root.find("model") is None:
            raise root.error("expected a <world> or a <model> in it")
        self._open.append(path.resolve())
        lights = [(light, light.find("pose")) for light in scope.all("light")]
        crowds = [one for crowd in scope.all("population") for one in spread(crowd, MOST_MODELS)]
        scope = replace(scope, children=[*scope.children, *crowds])
        models, _ = self._placed(scope, lights)
        models += [_road(road) for road in scope.all("road")]
        self._unsupported(scope, _UNSUPPORTED.keys() - {"light"})
        for inside, kind in (("gui", "plugin"), ("scene", "fog")):
            for element in scope.all(inside):
                self._unsupported(element, [kind])
        sun = self._sun(lights)
        return World(
            scope.attributes.get("name", path.stem),
            tuple(_as_saved(models, scope, self._notes)),
            sun,
            _ambient(scope.find("scene/ambient"), lights, sun is not None),
            scope.find("vrchain:scene"),
        )

    def _document(self, path: Path) -> Element:
        root = parse(read_bytes(path, MOST_XML_BYTES), path)
        if root.tag not in ("sdf", "gazebo"):
            raise root.error("expected <sdf> as the document's root")
        return root

    def _placed(self, scope: Element, lights: list[_Light]) -> tuple[list[Placed], Frames]:
        """The models of a world or model, and its frames; its included lights are added."""
        models: dict[Element, Model] = {}
        for element in scope.all("model", "include"):
            found = self._model(element) if element.tag == "model" else self._included(element)
            if isinstance(found, Model):
                models[element] = found
            elif found is None:
                continue
            elif found.tag == "light":
                lights.append((found, element.find("pose") or found.find("pose")))
            else:
                self._notes.add(_UNSUPPORTED.get(found.tag, found.tag), found.file.parent.name)
        frames = Frames(scope, models)
        if sum(model.count for model in models.values()) > MOST_MODELS:
            raise scope.error(f"expected at most {MOST_MODELS} models, in includes as well")
        placed = [
            Placed(name_of(element, model.name), model, frames.of(element, model.pose), element)
            for element, model in models.items()
        ]
        return placed, frames

    def _model(self, element: Element, design: str | None = None) -> Model:
        self._deep += 1
        if self._deep > MOST_INCLUDES_DEEP:
            raise element.error(f"models lie more than {MOST_INCLUDES_DEEP} deep in one another")
        self._unsupported(element)
        for joint in element.all("joint"):
            if joint.attributes.get("type") != "fixed":
                self._notes.add("joints that move", joint.name)
        name = element.name or element.file.parent.name
        lights: list[_Light] = []
        nested, frames = self._placed(element, lights)
        count = 1 + sum(p.model.count for p in nested)
        for _ in lights:
            self._notes.add(_UNSUPPORTED["light"], name)
        merged = [part for part in nested if is_merged(part.element)]
        nested = [part for part in nested if part not in merged]
        visuals = []
        for part in merged:
            visuals += [replace(v, matrix=part.matrix @ v.matrix) for v in part.model.visuals]
            nested += [replace(p, matrix=part.matrix @ p.matrix) for p in part.model.nested]
        for link in element.all("link"):
            self._unsupported(link)
            matrix = frames.of(link)
            for visual in link.all("visual"):
                self._unsupported(visual)
                visuals.append(Visual(visual, frames.of(visual, outer=matrix)))
        self._deep -= 1
        pose = pose_matrix(element.find("pose"))
        return Model(
            name,
            pose,
            tuple(visuals),
            tuple(nested),
            design or name,
            count,
            element.find("vrchain:object"),
            frames,
            element.attributes.get("placement_frame", ""),
        )

    def _included(self, include: Element) -> Model | Element | None:
        """The model of an <include>; or the element of what else it holds, such as a light.

        None, with a note, where there is none.
        """
        self._unsupported(include)
        file = self._model_file(include)
        if file is None:
            return None
        if file in self._open:
            circle = " -> ".join(str(f.name) for f in (*self._open, file))
            raise include.error(f"{include.words('uri')} includes itself: {circle}")
        if file not in self._models:
            self._open.append(file)
            root = self._document(file)
            found = next(root.all("model"), None) or next(root.all("light", "actor"), None)
            if found is None:
                raise root.error("expected a <model> in it")
            if found.tag == "model":
                in_folder = file.parent in self._folders.models
                self._models[file] = self._model(
                    found, file.stem if in_folder else file.parent.name
                )
            else:
                self._models[file] = found
            self._open.pop()
        return self._models[file]

    def _model_file(self, include: Element) -> Path | None:
        uri = include.words("uri")
        if not uri:
            raise include.error("expected a <uri>")
        found = self._folders.find(uri, include.file.parent, include)
        if found is None or is_file(found):
            if found is None:
                self._notes.lose("models that are missing", uri)
            return found
        config = self._folders.find("model.config", found, include)
        named = "model.sdf"
        if config is not None and is_file(config):
            listed = list(parse(read_bytes(config, MOST_XML_BYTES), config).all("sdf"))
            if listed:
                named = max(listed, key=_version).text
        file = self._folders.find(named, found, include)
        if file is None or not is_file(file):
            self._notes.lose("models that are missing", f"{uri}, whose folder has no {named!r}")
            return None
        return file

    def _unsupported(self, scope: Element, kinds: Iterable[str] = _UNSUPPORTED) -> None:
        pose = scope.find("pose")
        if pose is not None and pose.attributes.get("frame"):
            self._notes.add("frames of poses, as of SDF 1.5", pose.attributes["frame"])
        for element in scope.all(*kinds):
            name = element.attributes.get("filename") or element.name
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
                self._notes.add(_UNSUPPORTED["light"], light.name)
        return sun


def _ambient(given: Element | None, lights: Iterable[_Light], sunny: bool) -> float:
    """The brightness of what no light falls on; without a sun lamps light it, about."""
    said = given is not None and given.text
    ambient = _brightness(given) if said else 0.0 if sunny else _AMBIENT
    lamps = [light for light, _ in lights if light.attributes.get("type") in ("point", "spot")]
    if sunny or not lamps:
        return ambient
    shine = sum(_brightness(lamp.find("diffuse")) for lamp in lamps)
    return max(ambient, min(ambient + _LAMPS * shine, _LAMPLIT))


def _brightness(colour: Element | None) -> float:
    """The mean of a colour of three or four numbers; white if there is none."""
    if colour is None or not colour.text:
        return 1.0
    rgb = colour.numbers(min(max(len(colour.text.split()), 3), 4))[:3]
    return float(np.clip(rgb, 0, 1).mean())


def _version(sdf: Element) -> tuple[int, ...]:
    words = sdf.attributes.get("version", "0").split(".")
    return tuple(int(word) if word.isdecimal() and len(word) < 9 else 0 for word in words)


def _road(road: Element) -> Placed:
    """A <road> as a model of one visual."""
    shape = replace(road, tag="geometry", children=[road])
    visual = replace(road, tag="visual", children=[shape, *road.all("material")])
    frames, here, name = Frames(road, {}), np.eye(4), road.name or "road"
    model = Model(name, here, (Visual(visual, here),), (), name, 1, None, frames)
    return Placed(name, model, here, road)


def _as_saved(models: Iterable[Placed], scope: Element, notes: Notes) -> Iterator[Placed]:
    """The models where a saved <state> has put them."""
    state = scope.find("state")
    if state is None:
        yield from models
        return
    saved = {element.name: element for element in state.all("model")}
    deleted = {name.text for part in state.all("deletions") for name in part.all("name")}
    for placed in models:
        where = saved.get(placed.name)
        if placed.name in deleted:
            continue
        if where is None:
            yield placed
            continue
        pose = where.find("pose")
        matrix = placed.matrix if pose is None else pose_matrix(pose)
        if where.values("scale", (1.0, 1.0, 1.0)) != (1.0, 1.0, 1.0):
            notes.add("scales of a saved state", placed.name)
        for part in where.all("link", "model"):
            if _is_moved(part, placed.model, matrix):
                notes.add("parts that a saved state moves in their model", placed.name)
        yield replace(placed, matrix=matrix)
    if state.find("insertions/model") is not None:
        notes.add("models inserted in a saved state")


def _is_moved(saved: Element, model: Model, matrix: Matrix) -> bool:
    """Whether a saved part of a model, placed by a matrix, is elsewhere than in the model's file.

    Gazebo saves poses in the world, SDF has them in the model.
    """
    known = model.frames.find(saved.name)
    if known is None or saved.find("pose") is None:
        return False
    pose = pose_matrix(saved.find("pose"))
    return not any(np.allclose(pose, at, atol=0.01) for at in (known, matrix @ known))
