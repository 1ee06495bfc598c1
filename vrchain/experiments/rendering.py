"""How long it takes to draw a panorama, to cast its rays, and to build the scene it shows.

Durations come from ``perf_counter_ns``, on whatever machine this runs on.
"""

from collections.abc import Callable
from pathlib import Path
from time import perf_counter_ns

import numpy as np
import pandas as pd

from vrchain.errors import MissionError
from vrchain.experiments.landmarks.pairs import draw_poses
from vrchain.experiments.stopwatch import COLUMNS, race_us, timed
from vrchain.geometry import Pose
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world import load_scene
from vrchain.world.model import Scene
from vrchain.world.render import Renderer
from vrchain.world.render.reference import LitRenderer
from vrchain.world.truth import GroundTruth

_PANORAMA_BAR_US, _BUILD_BAR_US = 250_000.0, 5_000_000.0


def bench_render(
    spec: str | Path, n_positions: int, *, seed: int, rig: CameraRig | None = None
) -> pd.DataFrame:
    """One row a thing timed, with ``COLUMNS``; times in microseconds, NaN where there is none.

    panorama: drawn at free poses, the first one aside, in turns with pyrender's own lit pass on the
    same scene and poses (reference_us; ratio: of the medians); rays: object and range of every
    pixel of it; scene: once from the scene file until it can be drawn, libraries loaded. bar: what
    the median should not exceed. Raises SpecError, and MissionError without room or positions.
    """
    if n_positions < 1:
        raise MissionError(f"expected 1 position or more to draw at, got {n_positions}")
    rig = rig or CameraRig()
    Renderer(Scene("nothing", (1.0, 1.0), ()))  # loads the libraries, which is no part of a scene
    start_ns = perf_counter_ns()
    scene = load_scene(spec)
    renderer = Renderer(scene)
    build_us = (perf_counter_ns() - start_ns) / 1e3
    first, *poses = draw_poses(scene, n_positions + 1, generator(seed, "bench", "poses"))
    lit, truth = LitRenderer(scene), GroundTruth(scene)
    runners: dict[str, Callable[[Pose], object]] = {
        "drawn": lambda pose: renderer.render(pose, rig),
        "lit": lambda pose: lit.render(pose, rig),
        "cast": lambda pose: truth.look(pose, rig),
    }
    for run in runners.values():
        run(first)
    times_us = race_us(runners, poses, generator(seed, "bench", "turns"))
    size = f"{rig.n_views} x {rig.width_px} x {rig.height_px}"
    lit_us = float(np.median(times_us["lit"]))
    rows = [
        timed(f"panorama {size}", times_us["drawn"], lit_us, _PANORAMA_BAR_US),
        timed(f"rays {size}", times_us["cast"]),
        timed("scene", [build_us], bar_us=_BUILD_BAR_US),
    ]
    return pd.DataFrame(rows, columns=COLUMNS)
