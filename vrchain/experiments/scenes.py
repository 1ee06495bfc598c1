"""Scene after scene to measure in: suburbs of their own seeds, or a Gazebo world as it is."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cache, lru_cache, partial
from pathlib import Path

from vrchain.errors import SpecError
from vrchain.paths import scene_file
from vrchain.seeding import generator
from vrchain.world import Scene, build_scene, load_scene, load_spec
from vrchain.world.gazebo import SUFFIXES
from vrchain.world.spec import SceneSpec, parse_spec


@dataclass(frozen=True)
class Scenes:
    """scene: scene k of a seed. digest: what they are made of. varied: whether they differ.

    spec: of suburbs, their seed aside.
    """

    scene: Callable[[int, int], Scene] = field(compare=False)
    digest: str
    varied: bool = True
    spec: SceneSpec | None = field(default=None, compare=False)

    def at(self, season: str | None, time: str | None) -> "Scenes":
        """The same in another season, at another time of day; as they are if None. SpecError."""
        if season is None and time is None:
            return self
        if self.spec is None:
            raise SpecError("a Gazebo world has no seasons and times of day: take a scene file")
        then = self.spec
        if season is not None:
            then = replace(then, season=parse_spec({"season": season}).season)
        if time is not None:
            then = replace(then, light=parse_spec({"light": {"time": time}}).light)
        return suburbs(then)


def scenes_of(path: str | Path) -> Scenes:
    """The scenes that a file stands for. Raises SpecError.

    A spec is drawn with a seed of its own for every (seed, k); a Gazebo world stays as it is, and
    is told from others by its models too, wherever those were found.
    """
    path = scene_file(path)
    if path.suffix.lower() not in SUFFIXES:
        return suburbs(load_spec(path))
    _loaded.cache_clear()
    digest = _digest(path, _loaded(path))
    return Scenes(partial(_world, path), digest, varied=False)


def remembered(scenes: Scenes) -> Scenes:
    """The same, each built but once; what was remembered before is forgotten."""
    _known.cache_clear()
    return replace(scenes, scene=partial(_known, scenes))


@cache
def _known(scenes: Scenes, seed: int, k: int) -> Scene:
    return scenes.scene(seed, k)


def suburbs(spec: SceneSpec) -> Scenes:
    """Suburbs that differ in their seeds alone."""
    known = json.dumps(asdict(spec), sort_keys=True).encode()
    return Scenes(partial(_suburb, spec), hashlib.sha256(known).hexdigest(), spec=spec)


def _suburb(spec: SceneSpec, seed: int, k: int) -> Scene:
    return build_scene(spec_of(spec, seed, k))


def _world(path: Path, seed: int, k: int) -> Scene:
    return _loaded(path)


@lru_cache(maxsize=1)
def _loaded(path: Path) -> Scene:
    return load_scene(path)


def _digest(path: Path, scene: Scene) -> str:
    """Of a world's file and of the things in it: their light follows from those."""
    content = hashlib.sha256(path.read_bytes())
    for thing in scene.objects:
        known = thing.name, thing.kind, thing.model, thing.landmark, thing.solid, thing.size_m
        content.update(repr((*known, thing.outline and thing.outline.wkt)).encode())
        for surface in thing.surfaces:
            content.update(surface.digest)
    return content.hexdigest()


def spec_of(spec: SceneSpec, seed: int, k: int) -> SceneSpec:
    """The spec with the seed of suburb ``k`` of a seed."""
    return replace(spec, seed=seed_of(seed, k))


def seed_of(seed: int, k: int) -> int:
    """The seed of suburb ``k`` of a seed: things of one number in two suburbs share no draws."""
    return int(generator(seed, "suburb", k).integers(2**31))
