"""Photographs: how many pairs of one place are claimed, how many of two, and by which settings.

``choose`` tries settings on rendered views of suburbs. Which of them to take was decided after the
photographs of the project's tests had been looked at: what they do on these is no independent
evidence.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import ImageError
from vrchain.experiments.landmarks.pairs import draw_poses
from vrchain.geometry import Pose
from vrchain.landmarks.matching.photos import (
    PLAIN,
    Described,
    PhotoConfig,
    agreeing,
    claims_of,
    described,
)
from vrchain.landmarks.training.examples import varied_suburb
from vrchain.panorama import CameraRig, read_image
from vrchain.seeding import generator
from vrchain.world.model import Scene
from vrchain.world.render import Renderer

CAMERA = CameraRig(n_views=1, width_px=1000, height_px=750)
CHOOSING_SEED = 1000
FALSE_SHARE = 0.01  # of unrelated pairs that may be claimed
_SUBURBS = {"unrelated": range(100, 120), "related": range(130, 138)}
_VIEWS, _PAIRS = 4, 16  # of each suburb
_UNRELATED = 600
_BUILDINGS = ("house", "shop", "barn")
_RANGE_M, _AZIMUTH_RAD, _ASIDE_RAD = (9.0, 20.0), 0.7, 0.25
_TRIES = 400
_SUFFIXES = (".jpg", ".jpeg", ".png")


def choose(suburbs: int | None = None) -> pd.DataFrame:
    """Settings tried on rendered views: one row each, the best first.

    Of each the least number of agreeing matches with which at most ``FALSE_SHARE`` of unrelated
    pairs are claimed, and the share of related ones that is claimed then. Of equals the strictest
    tolerance is best.
    """
    kinds = {"unrelated": unrelated_pairs, "related": related_pairs}
    pairs = {name: list(drawn(suburbs)) for name, drawn in kinds.items()}
    rows = []
    for ratio, tolerance_px in product((0.8, 0.85), (1.0, 1.5, 2.0, 4.0)):
        tried = replace(PhotoConfig(), ratio=ratio, tolerance_px=tolerance_px)
        counts = {
            name: np.array([len(agreeing(a, b, tried)[0]) for a, b in tqdm(own, disable=None)])
            for name, own in pairs.items()
        }
        ordered = np.sort(counts["unrelated"])
        least = int(ordered[int(np.ceil(len(ordered) * (1 - FALSE_SHARE))) - 1]) + 1
        rows.append(
            {
                "ratio": ratio,
                "tolerance_px": tolerance_px,
                "min_inliers": least,
                "related_claimed": float((counts["related"] >= least).mean()),
                "unrelated_claimed": float((counts["unrelated"] >= least).mean()),
                "related": len(counts["related"]),
                "unrelated": len(counts["unrelated"]),
            }
        )
    best = ["related_claimed", "tolerance_px", "ratio"]
    return pd.DataFrame(rows).sort_values(best, ascending=[False, True, True], ignore_index=True)


def unrelated_pairs(suburbs: int | None = None) -> Iterator[tuple[Described, Described]]:
    """Pairs of views, each of another suburb."""
    views = []
    for k in tqdm(_SUBURBS["unrelated"][:suburbs], desc="unrelated", disable=None):
        scene = varied_suburb(CHOOSING_SEED, k)
        views += [(k, v) for v in _views(scene, _VIEWS, generator(CHOOSING_SEED, "photos", k))]
    pairs = [(a, b) for (i, a), (j, b) in combinations(views, 2) if i != j]
    chosen = generator(CHOOSING_SEED, "photos").permutation(len(pairs))[:_UNRELATED]
    for n in np.sort(chosen):
        yield pairs[n]


def related_pairs(suburbs: int | None = None) -> Iterator[tuple[Described, Described]]:
    """Pairs of views of one building, up to 40 degrees apart; something may stand in between."""
    for k in tqdm(_SUBURBS["related"][:suburbs], desc="related", disable=None):
        scene = varied_suburb(CHOOSING_SEED, k)
        renderer, draws = Renderer(scene), generator(CHOOSING_SEED, "photos", k, "related")
        middles = [o.bounds_m.mean(axis=0)[:2] for o in scene.objects if o.kind in _BUILDINGS]
        made = 0
        for _ in range(_TRIES):
            middle = middles[int(draws.integers(len(middles)))]
            azimuth = draws.uniform(-np.pi, np.pi)
            azimuths = azimuth + np.array([0.0, draws.uniform(-_AZIMUTH_RAD, _AZIMUTH_RAD)])
            away = np.stack([np.cos(azimuths), np.sin(azimuths)], axis=1)
            places = middle + draws.uniform(*_RANGE_M, (2, 1)) * away
            yaws = azimuths + np.pi + draws.uniform(-_ASIDE_RAD, _ASIDE_RAD, 2)
            if not scene.is_free(places).all():
                continue
            a, b = (
                described(renderer.render(Pose(*map(float, (*p, yaw))), CAMERA).views[0])
                for p, yaw in zip(places, yaws, strict=True)
            )
            yield a, b
            made += 1
            if made == _PAIRS:
                break


def compare_folders(folders: Sequence[Path], rendered: int = 20) -> pd.DataFrame:
    """Pairs of photographs claimed, by our settings and by plain ones: one row a kind of pair.

    Kinds: those within each folder, those across folders, and each photograph beside ``rendered``
    views of suburbs. ImageError if a folder holds no photographs.
    """
    taken = {folder: _photographs(folder) for folder in dict.fromkeys(folders)}
    names = [folder.name for folder in taken]
    kinds: list[tuple[str, list[tuple[Described, Described]]]] = [
        (f.name if names.count(f.name) == 1 else str(f), list(combinations(own, 2)))
        for f, own in taken.items()
    ]
    across = [pair for a, b in combinations(taken.values(), 2) for pair in product(a, b)]
    views: list[Described] = []
    for k in range(-(-rendered // _VIEWS)):
        scene = varied_suburb(CHOOSING_SEED, 200 + k)
        views += _views(scene, _VIEWS, generator(CHOOSING_SEED, "photos", "beside", k))
    every = [photograph for own in taken.values() for photograph in own]
    beside = list(product(every, views[:rendered]))
    rows = []
    for kind, pairs in [*kinds, ("across", across), ("beside rendered views", beside)]:
        row: dict[str, object] = {"pairs": kind, "n": len(pairs)}
        for name, config in (("claimed", PhotoConfig()), ("claimed_by_plain_sift", PLAIN)):
            bar = tqdm(pairs, desc=f"{kind}, {name}", unit="", disable=None)
            row[name] = sum(bool(claims_of(a, b, config)) for a, b in bar)
        rows.append(row)
    return pd.DataFrame(rows)


def _photographs(folder: Path) -> list[Described]:
    files = sorted(f for f in folder.glob("*") if f.suffix.lower() in _SUFFIXES)
    if not files:
        raise ImageError(f"{folder}: expected a folder of photographs ({', '.join(_SUFFIXES)})")
    return [described(read_image(f)) for f in files]


def _views(scene: Scene, n: int, draws: np.random.Generator) -> list[Described]:
    renderer = Renderer(scene)
    return [
        described(renderer.render(pose, CAMERA).views[0]) for pose in draw_poses(scene, n, draws)
    ]
