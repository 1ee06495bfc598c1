"""Panoramas that have nothing in common: how often a variant claims a landmark all the same."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from itertools import combinations
from pathlib import Path
from typing import Any

import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import MissionError
from vrchain.experiments.intervals import Bootstrap, shown
from vrchain.experiments.kept import folder_of, kept
from vrchain.experiments.landmarks.pairs import draw_poses
from vrchain.experiments.landmarks.precision import PAIRS_A_SUBURB, looks_of, makers
from vrchain.experiments.scenes import Scenes
from vrchain.landmarks.matching.variants import Variant
from vrchain.landmarks.quality import co_visible
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth


def strangers(
    scenes: Scenes,
    n_pairs: int,
    variants: Sequence[Variant],
    *,
    seed: int,
    folder: Path,
    rig: CameraRig | None = None,
) -> pd.DataFrame:
    """Pairs with nothing in common, half of one suburb, half of two: one row a pair and variant.

    Columns: suburb, pair, variant, two_suburbs, score (of the surest claim, 0 without any). What
    was found already under ``folder`` is read from there. MissionError if the scenes do not differ.
    """
    if n_pairs < 1:
        raise MissionError(f"expected 1 pair or more, got {n_pairs}")
    if not scenes.varied:
        raise MissionError(
            "expected the spec of a suburb, of which many are drawn, got one world: "
            "what stands in it is no stranger to itself"
        )
    rig = rig or CameraRig()
    own = folder_of(folder, scenes, ["strangers"], makers(variants), seed, asdict(rig))
    seen = lru_cache(maxsize=2)(partial(_seen, scenes, variants, seed, rig))

    def find(k: int) -> list[dict[str, object]]:
        before = seen(k - 1).looks if k else []
        return _compared(seen(k), before, variants)

    wanted = {False: n_pairs - n_pairs // 2, True: n_pairs // 2}
    rows: dict[bool, list[dict[str, object]]] = {False: [], True: []}
    with tqdm(total=n_pairs, desc="pairs of strangers", unit="", disable=None) as progress:
        for k in range(10 * n_pairs):
            for row in kept(own / f"suburb_{k:04d}.json", partial(find, k)):
                made = rows[row["two_suburbs"]]
                if len(made) < wanted[row["two_suburbs"]] * len(variants):
                    made.append({"suburb": k, **row})
            n_made = sum(map(len, rows.values())) // len(variants)
            progress.update(n_made - progress.n)
            if n_made == n_pairs:
                break
    return pd.DataFrame([*rows[False], *rows[True]])


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is made of a suburb's panoramas, and which two of them have nothing in common."""

    looks: list[dict[Any, Any]]
    apart: list[tuple[int, int]]


def _seen(scenes: Scenes, variants: Sequence[Variant], seed: int, rig: CameraRig, k: int) -> _Seen:
    scene = scenes.scene(seed, k)
    renderer, truth = Renderer(scene), GroundTruth(scene)
    poses = draw_poses(scene, PAIRS_A_SUBURB, generator(seed, "strangers", k))
    looks = [looks_of(renderer.render(pose, rig), variants) for pose in poses]
    apart = [
        (i, j)
        for i, j in combinations(range(len(poses)), 2)
        if not co_visible(truth, poses[i], poses[j], rig)
    ]
    return _Seen(looks, apart)


def _compared(
    here: _Seen, before: list[dict[Any, Any]], variants: Sequence[Variant]
) -> list[dict[str, object]]:
    """Rows of pairs within a suburb, and of pairs with the suburb before, as many at most."""
    # each panorama about twice, not the first one in nearly all
    apart = sorted(here.apart, key=lambda pair: (pair[1] - pair[0], pair))[:PAIRS_A_SUBURB]
    pairs = [(False, here.looks[i], here.looks[j]) for i, j in apart]
    pairs += [(True, a, b) for a, b in zip(before, here.looks, strict=False)]
    rows: list[dict[str, object]] = []
    for number, (two, a, b) in enumerate(pairs):
        for variant in variants:
            claims = variant.compare(a[variant.look], b[variant.look]).common
            score = max((c.score for c in claims), default=0.0)
            rows.append(
                {"pair": number, "variant": variant.name, "two_suburbs": two, "score": score}
            )
    return rows


def accused(found: pd.DataFrame) -> pd.DataFrame:
    """Of ``strangers``, the share of pairs with a claim, and its 95 % interval over suburbs.

    Columns: variant, two_suburbs, pairs, claimed, claimed_ci.
    """
    rows: list[dict[str, object]] = []
    for (variant, two), own in found.groupby(["variant", "two_suburbs"], sort=False):
        told = Bootstrap(own.suburb, "strangers").share("claimed", own.score > 0, own.suburb)
        rows.append({"variant": variant, "two_suburbs": two, "pairs": len(own), **told})
    return pd.DataFrame(rows)


def as_text(rows: pd.DataFrame) -> str:
    """The table of ``accused`` to read, intervals in brackets."""
    claimed = [shown(dict(row), "claimed") for _, row in rows.iterrows()]
    return rows.assign(claimed=claimed).drop(columns="claimed_ci").to_string(index=False)
