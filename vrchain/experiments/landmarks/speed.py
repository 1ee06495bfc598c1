"""How long landmarks take: to propose, to extract for publishing, and to find two robots' common.

SIFT over whole panoramas, on the same pictures and in turns with it, is the reference.
"""

from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from vrchain.errors import MissionError
from vrchain.experiments.landmarks.pairs import draw_pairs, draw_poses
from vrchain.experiments.stopwatch import COLUMNS, race_us, timed
from vrchain.landmarks.extraction.proposer import propose
from vrchain.landmarks.extraction.record import examine
from vrchain.landmarks.extraction.sift import extract
from vrchain.landmarks.extraction.weights import load_network
from vrchain.landmarks.matching.variants import Variant, variant_named
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world import load_scene
from vrchain.world.render import Renderer

SPACING_M = (1.0, 20.0)  # between the two of a pair
_PROPOSE_BAR_US, _PAIR_BAR_US = 150_000.0, 30_000.0


def bench_landmarks(spec: str | Path, n_positions: int, *, seed: int) -> pd.DataFrame:
    """One row a thing timed, with ``COLUMNS``; times in microseconds, NaN where there is none.

    propose: the network's one pass and its proposals; examine: that and keypoints, as a publisher
    does it, beside SIFT alone; pair: two panoramas compared, extracted before, by each variant,
    beside SIFT over the whole of both. Raises as ``load_scene``,
    and MissionError without room or positions.
    """
    if n_positions < 1:
        raise MissionError(f"expected 1 position or more, got {n_positions}")
    scene, rig = load_scene(spec), CameraRig()
    renderer, network = Renderer(scene), load_network()
    order = generator(seed, "bench", "landmarks")
    poses = draw_poses(scene, n_positions, generator(seed, "bench", "poses"))
    taken = [renderer.render(pose, rig) for pose in poses]
    for panorama in taken:
        _ = panorama.cylinder  # joined once, and used by all
    first = taken[0]
    propose(first, network), examine(first)  # to warm up
    looks = race_us(
        {"propose": partial(propose, network=network), "examine": examine, "sift": extract},
        taken, order,
    )  # fmt: skip
    sift_us = float(np.median(looks["sift"]))
    rows = [
        timed("propose", looks["propose"], sift_us, _PROPOSE_BAR_US),
        timed("examine", looks["examine"], sift_us),
    ]
    variants = {name: variant_named(name) for name in ("cnn", "cnn+sift", "sift")}
    pairs = [
        (renderer.render(a, rig), renderer.render(b, rig))
        for a, b in draw_pairs(scene, n_positions, SPACING_M, seed)
    ]
    seen = [
        {name: (v.look(a), v.look(b)) for name, v in variants.items()} for a, b in pairs
    ]  # fmt: skip
    compared = race_us({n: partial(_compare, n, v) for n, v in variants.items()}, seen, order)
    sift_us = float(np.median(compared.pop("sift")))
    rows += [
        timed(f"pair {name}", times, sift_us, _PAIR_BAR_US) for name, times in compared.items()
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def _compare(name: str, variant: Variant, seen: dict) -> object:
    return variant.compare(*seen[name])
