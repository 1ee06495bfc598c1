"""Suburbs for tests: what is ground in them, their digest, a small one, and fresh processes."""

import hashlib
import os
import subprocess
import sys

import numpy as np
import shapely

from vrchain.experiments.scenes import spec_of
from vrchain.paths import ROOT, SCENES
from vrchain.seeding import generator
from vrchain.world import Scene, SceneObject, build_scene, load_spec
from vrchain.world.spec import SceneSpec, parse_spec
from vrchain.world.suburb.ground import build_ground
from vrchain.world.suburb.layout import draw_layout

SUBURB = SCENES / "suburb.yaml"
GROUND = {"grass", "road", "kerb", "pavement", "marking", "driveway", "path", "backdrop"}
SMALL = {
    "extent_m": [70, 90], "houses": {"count": 3}, "shops": {"count": 0}, "barns": {"count": 0},
    "trees": {"count": 8}, "vehicles": {"count": 2},
    "boundaries": {"fences": 2, "walls": 1, "hedges": 2},
    "furniture": {"mailboxes": 2, "lamps": 2, "poles": 1, "signs": 1, "bins": 1, "hydrants": 1,
                  "bushes": 3},
}  # fmt: skip


def small(time: str, season: str) -> Scene:
    """A small suburb in some light and season."""
    return build_scene(parse_spec({**SMALL, "light": {"time": time}, "season": season}))


def digest(scene: Scene) -> str:
    """Of every byte that is drawn, and of every name."""
    total = hashlib.sha256()
    sky = [scene.sky] if scene.sky else []
    for name, surfaces in [*((o.name, o.surfaces) for o in scene.objects), ("sky", sky)]:
        total.update(name.encode())
        for s in surfaces:
            for array in (s.vertices_m, s.faces, s.uv, s.shade, s.texture):
                total.update(np.ascontiguousarray(array).tobytes())
    if scene.ground_light is not None:
        total.update(scene.ground_light.image.tobytes())
    return total.hexdigest()


def ground_digest() -> str:
    """Of the ground of a suburb whose lawns were cut otherwise by another arctan2."""
    spec = spec_of(load_spec(SUBURB), 10_000, 0)
    ground = build_ground(draw_layout(spec), spec.extent_m, spec.season, generator(0, "ground"))
    corners = b"".join(s.vertices_m.tobytes() for o in ground for s in o.surfaces)
    return hashlib.sha256(corners).hexdigest()


def asked_for(spec: SceneSpec) -> dict[str, int]:
    """How many things of each kind a spec asks for."""
    counts = {k: getattr(spec, f"{k}s").count for k in ("house", "shop", "barn", "tree", "vehicle")}
    singular = {"mailboxes": "mailbox", "bushes": "bush"}
    for part in (spec.boundaries, spec.furniture):
        counts |= {singular.get(key, key[:-1]): n for key, n in vars(part).items()}
    return counts


def too_close(solids: list[SceneObject]) -> list[tuple[str, str]]:
    """Pairs of things that a robot could not pass between."""
    prints = np.array([o.footprint for o in solids], dtype=object)
    first, second = shapely.STRtree(prints).query(prints, predicate="dwithin", distance=0.8)
    return [(solids[a].name, solids[b].name) for a, b in zip(first, second, strict=True) if a < b]


def printed_by_a_fresh_process(code: str, **told: str) -> str:
    """What ``code`` prints, which finds these helpers, with hashes of another seed.

    told: more of its environment.
    """
    paths = {"PYTHONHASHSEED": "7", "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}
    command = [sys.executable, "-c", f"from suburbs import *; {code}"]
    done = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, **paths, **told}, check=True
    )
    return done.stdout.strip()
