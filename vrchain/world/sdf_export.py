"""Our own suburbs as Gazebo worlds: SDF with a model a design, its mesh, materials and textures.

Meshes and pictures are as built, before light falls on them: Gazebo has a light of its own. What it
has no word for stands in elements of the namespace ``vrchain``, which it passes over; by them the
importer finds the same objects, season, light and sky again.
"""

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from xml.sax.saxutils import quoteattr

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import OutputError, SpecError
from vrchain.files import name_of, write_file
from vrchain.geometry import Pose
from vrchain.world.build import designs, floor
from vrchain.world.light import sunlight
from vrchain.world.model import OPAQUE, SceneObject, Surface
from vrchain.world.spec import SceneSpec

SUFFIX = ".world"
NAMESPACE = "urn:vrchain:sdf"
_WORDS = {True: "true", False: "false"}


_Placed = tuple[SceneObject, Pose]  # an object in its design's frame, and its place


def export_world(spec: SceneSpec, path: str | Path) -> None:
    """Write the suburb of a spec as PATH, a ``.world``, and its models in ``models`` beside it.

    Every file is written whole or not at all, the world last. Raises OutputError and SpecError.
    """
    target = Path(path)
    if target.suffix.lower() != SUFFIX:
        raise OutputError(f"expected a file name that ends in {SUFFIX}, got {path}")
    if spec.layout != "suburb":
        raise SpecError(
            f"expected the layout 'suburb' for a Gazebo world, got {spec.layout!r}: "
            "write it as .glb instead"
        )
    if not spec.name.isprintable():
        raise SpecError(
            f"expected a name that XML can hold, without control characters, got {spec.name!r}"
        )
    for name, content in world_files(spec, target.name):
        write_file(target.parent / name, content)


def world_files(spec: SceneSpec, world: str) -> Iterator[tuple[str, bytes]]:
    """The files of a suburb by their paths: those of its models, at last the world."""
    things: list[_Placed] = [
        (SceneObject(p.name, p.kind, p.model, True, True, (0.0, 0.0, 0.0), surfaces), p.pose)
        for p, surfaces in designs(spec)
    ]
    things += [(thing, Pose(0.0, 0.0)) for thing in floor(spec)]
    # No other spec's models begin like this, so worlds may share a folder.
    named = "".join(c if c.isalnum() else "_" for c in spec.name)
    prefix = f"{named}_{name_of(asdict(spec))[:8]}"
    pictures: dict[int, tuple[str, str]] = {}  # of each texture, the folder and file it is in
    models: dict[str, SceneObject] = {}
    for thing, _ in things:
        models.setdefault(thing.model, thing)
    for model, thing in models.items():
        folder = f"{prefix}_{model}"
        for name, content in _model_files(folder, thing, pictures):
            yield f"models/{folder}/{name}", content
    yield world, _world(spec, things, prefix).encode()


def _model_files(
    folder: str, thing: SceneObject, pictures: dict[int, tuple[str, str]]
) -> Iterator[tuple[str, bytes]]:
    """A model's files; ``pictures`` tells which are written already, and where."""
    scripts, visuals = [], []
    for number, surface in enumerate(thing.surfaces):
        if id(surface.texture) not in pictures:
            file = f"{folder}_{number}.png"
            pictures[id(surface.texture)] = folder, file
            yield f"materials/textures/{file}", _png(surface.texture)
        home, file = pictures[id(surface.texture)]
        rejected = f"alpha_rejection greater_equal {OPAQUE}\n" if surface.cut_out else ""
        scripts.append(
            f"material {folder}/{number}\n{{\ntechnique\n{{\npass\n{{\n{rejected}"
            f"texture_unit\n{{\ntexture {file}\n}}\n}}\n}}\n}}\n"
        )
        visuals.append(
            f'<visual name="{number}"><geometry><mesh><uri>model://{folder}/meshes/mesh.obj</uri>'
            f"<submesh><name>part_{number}</name></submesh></mesh></geometry><material><script>"
            f"<uri>model://{folder}/materials/scripts</uri>"
            f"<uri>model://{home}/materials/textures</uri>"
            f"<name>{folder}/{number}</name></script></material></visual>"
        )
    yield "meshes/mesh.obj", "".join(_obj(thing.surfaces)).encode()
    yield "materials/scripts/model.material", "\n".join(scripts).encode()
    lines = "\n".join(visuals)
    yield (
        "model.sdf",
        f'<?xml version="1.0"?>\n<sdf version="1.6" xmlns:vrchain="{NAMESPACE}">\n'
        f'<model name="{folder}"><static>true</static>\n'
        f'<vrchain:object kind="{thing.kind}" model="{thing.model}" '
        f'landmark="{_WORDS[thing.landmark]}" solid="{_WORDS[thing.solid]}"/>\n'
        f'<link name="link">\n{lines}\n<collision name="c"><geometry><mesh>'
        f"<uri>model://{folder}/meshes/mesh.obj</uri></mesh></geometry></collision>"
        "\n</link></model>\n</sdf>\n".encode(),
    )
    yield (
        "model.config",
        f'<?xml version="1.0"?>\n<model><name>{folder}</name><version>1.0</version>'
        '<sdf version="1.6">model.sdf</sdf></model>\n'.encode(),
    )


def _obj(surfaces: Iterable[Surface]) -> Iterator[str]:
    """Surfaces as OBJ, a group each; shades are vertex colours. Numbers keep every bit."""
    first = 1
    for number, surface in enumerate(surfaces):
        yield from _lines("v", np.concatenate([surface.vertices_m, surface.shade_rgb], axis=1))
        yield from _lines("vt", surface.uv)
        yield f"g part_{number}\n"
        for a, b, c in (surface.faces + first).tolist():
            yield f"f {a}/{a} {b}/{b} {c}/{c}\n"
        first += len(surface.vertices_m)


def _lines(word: str, rows: NDArray[np.floating]) -> Iterator[str]:
    for row in rows.tolist():
        yield f"{word} {' '.join(f'{v:.9g}' for v in row)}\n"


def _png(texture: NDArray[np.uint8]) -> bytes:
    order = [2, 1, 0, 3][: texture.shape[2]]
    return cv2.imencode(".png", texture[..., order])[1].tobytes()


def _world(spec: SceneSpec, things: Iterable[_Placed], prefix: str) -> str:
    x, y, z = (-sunlight(spec.light).direction).tolist()
    light = spec.light
    lines = [
        '<?xml version="1.0"?>',
        f'<sdf version="1.6" xmlns:vrchain="{NAMESPACE}">',
        f"<world name={quoteattr(spec.name)}>",
        f'<light name="sun" type="directional"><direction>{x!r} {y!r} {z!r}</direction></light>',
        f'<vrchain:scene seed="{spec.seed}" season="{spec.season}" '
        f'extent_x_m="{spec.extent_m[0]!r}" extent_y_m="{spec.extent_m[1]!r}" '
        f'time="{light.time}" sun_azimuth_deg="{light.sun_azimuth_deg!r}" '
        f'sun_elevation_deg="{light.sun_elevation_deg!r}" ambient="{light.ambient!r}"/>',
    ]
    lines += [
        f"<include><name>{thing.name}</name><uri>model://{prefix}_{thing.model}</uri>"
        f"<pose>{pose.x_m!r} {pose.y_m!r} 0 0 0 {pose.yaw_rad!r}</pose></include>"
        for thing, pose in things
    ]
    return "\n".join([*lines, "</world>", "</sdf>", ""])
