"""How the precision of common landmarks is measured, and recall and relative pose: by variant.

``evaluate`` draws pairs of poses in suburb after suburb, about ten in each, and judges every claim
of each variant by ground truth: a row a claim and a row a pair. ``summarise`` makes the figures of
them, as docs/reference/definitions.md has them, ``as_table`` a table to read.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vrchain.errors import MissionError
from vrchain.experiments.intervals import Bootstrap, or_none, ratio, shown, table_of
from vrchain.experiments.kept import folder_of, kept_each
from vrchain.experiments.landmarks.degradations import Degradation, tilted, unchanged
from vrchain.experiments.landmarks.pairs import draw_pairs, judged
from vrchain.experiments.scenes import Scenes
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.sift import Directions, Features, mutual_matches
from vrchain.landmarks.matching.calibration import expected_calibration_error
from vrchain.landmarks.matching.common import (
    CommonLandmark,
    Comparison,
    MatchConfig,
    panorama_region,
    support_score,
)
from vrchain.landmarks.matching.epipolar import estimate
from vrchain.landmarks.matching.levelling import upright
from vrchain.landmarks.matching.variants import DEFAULT, Variant, sift, variant_named
from vrchain.landmarks.quality import names_in_common, pose_errors_deg
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

PAIRS_A_SUBURB = 10
LEAST_SCORE = 0.02  # claims are kept from here on, to see what other thresholds would do
PRECISIONS = (0.90, 0.95, 0.98)
GIVEN = "sift, regions given"
ROWS = ("sift", GIVEN, "cnn", DEFAULT)
_CLAIM = (
    "pair", "variant", "score", "right", "shared", "twin", "duplicate", "quality_m", "support",
    "object_a", "object_b",
)  # fmt: skip
_KEY = ["suburb", "pair"]


def row(name: str) -> Variant:
    """The variant of a table's row, with all its claims that are worth keeping."""
    if name == GIVEN:
        return replace(sift(LEAST_SCORE), name=GIVEN)
    return variant_named(name, LEAST_SCORE)


@dataclass(frozen=True)
class Second:
    """How the second panorama of each pair differs from the first: in its picture, height or tilt.

    name: under which what is found is kept. tilt_deg: of its cameras, about an axis that is drawn.
    """

    name: str
    spoil: Degradation = unchanged
    rise_m: float = 0.0
    tilt_deg: float = 0.0

    def rig(self, first: CameraRig) -> CameraRig:
        """The second robot's cameras."""
        return replace(first, camera_height_m=first.camera_height_m + self.rise_m)


AS_DRAWN = Second("as drawn")


def evaluate(
    scenes: Scenes,
    n_pairs: int,
    spacing_m: tuple[float, float],
    variants: Sequence[Variant],
    *,
    seed: int,
    folder: Path,
    rig: CameraRig | None = None,
    second: Second = AS_DRAWN,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Claims and pairs of ``n_pairs`` random pairs, one row each; what is under ``folder`` is read.

    Claims: suburb, pair, variant, score, right, shared (right, and the landmark co-visible), twin,
    duplicate, quality_m, support, object_a, object_b. Pairs: suburb, pair, variant, claimed (the
    score from which a claim counts), surest (from which a pair's surest one does), spacing_m,
    co_visible, ms, direction_error_deg and heading_error_deg (180: no answer). In a world
    that stays as it is, each pair has a suburb's number of its own: intervals are over pairs there.
    """
    if n_pairs < 1 or not 0 < spacing_m[0] <= spacing_m[1] < np.inf:
        raise MissionError(
            f"expected 1 pair or more and 0 < MIN <= MAX metres, got {n_pairs} and {spacing_m}"
        )
    rig = rig or CameraRig()
    own = folder_of(
        folder, scenes, list(spacing_m), makers(variants), seed, asdict(rig), second.name
    )
    sizes = [min(PAIRS_A_SUBURB, n_pairs - n) for n in range(0, n_pairs, PAIRS_A_SUBURB)]
    files = [own / f"suburb_{k:04d}_{n}.json" for k, n in enumerate(sizes)]
    find = partial(_suburb, scenes, sizes, spacing_m, variants, seed, rig, second)
    found = kept_each(find, files, 1, "suburbs")
    claims, pairs = (
        [{"suburb": k, **row} for k, suburb in enumerate(found) for row in suburb[name]]
        for name in ("claims", "pairs")
    )
    made, drawn = pd.DataFrame(claims, columns=["suburb", *_CLAIM]), pd.DataFrame(pairs)
    if not scenes.varied:
        made, drawn = (t.assign(suburb=t.suburb * PAIRS_A_SUBURB + t.pair) for t in (made, drawn))
    return made, drawn


def makers(variants: Sequence[Variant]) -> list[tuple[str, str]]:
    """What results of variants depend on. MissionError for two variants of one name."""
    names = [v.name for v in variants]
    if len({*names}) < len(names):
        raise MissionError(
            f"expected variants of different names, got {', '.join(names)}: "
            "their results could not be told apart"
        )
    return [(v.name, v.maker) for v in variants]


def _suburb(
    scenes: Scenes,
    sizes: Sequence[int],
    spacing_m: tuple[float, float],
    variants: Sequence[Variant],
    seed: int,
    rig: CameraRig,
    second: Second,
    k: int,
) -> dict[str, list[dict[str, object]]]:
    """Claims and pairs of suburb ``k``, a row each."""
    scene = scenes.scene(seed, k)
    renderer, truth = Renderer(scene), GroundTruth(scene)
    claims: list[dict[str, object]] = []
    pairs: list[dict[str, object]] = []
    drawn = list(draw_pairs(scene, sizes[k], spacing_m, seed * 100_003 + k))
    rigs = rig, second.rig(rig)
    for number, poses in enumerate(drawn):
        a, b = (renderer.render(*own) for own in zip(poses, rigs, strict=True))
        draws = generator(seed, second.name, k, number)
        b = second.spoil(b, draws)
        axis_rad, tilt_rad = float(draws.uniform(-np.pi, np.pi)), float(np.radians(second.tilt_deg))
        if tilt_rad:
            b = tilted(b, tilt_rad, axis_rad)
        looks = [looks_of(panorama, variants) for panorama in (a, b)]
        shared = names_in_common(truth, *poses, rigs)
        for variant in variants:
            a, b = (look[variant.look] for look in looks)
            features = variant.keypoints(a), variant.keypoints(b)
            start = perf_counter()
            if variant.name == GIVEN:
                found = regions_given(*features, rig, poses, truth)
            else:
                found = variant.compare(a, b)
            ms = (perf_counter() - start) * 1e3
            if tilt_rad:  # truth is asked along upright rays
                turn = tilt_rad * np.array([np.cos(axis_rad), np.sin(axis_rad)])
                found, features = _upright(found, features, turn)
            which = {"pair": number, "variant": variant.name}
            claims += [which | row for row in judged(found, truth, poses, features, rigs, shared)]
            direction, heading = pose_errors_deg(found.geometry, *poses)
            pairs.append(
                {
                    **which,
                    "claimed": variant.claimed,
                    "surest": variant.claimed if variant.surest is None else variant.surest,
                    "spacing_m": poses[0].distance_to_m(poses[1].xy_m),
                    "co_visible": len(shared),
                    "ms": ms,
                    "direction_error_deg": direction,
                    "heading_error_deg": heading,
                }
            )
    return {"claims": claims, "pairs": pairs}


def _upright(
    found: Comparison, features: tuple[Features, Features], tilt_rad: NDArray[np.float64]
) -> tuple[Comparison, tuple[Features, Features]]:
    """What was found, as if B's cameras had seen it that are not tilted about x and y by (2,)."""
    common = tuple(
        c
        if c.mask_b is None
        else replace(c, mask_b=upright(Directions(*c.mask_b.T), tilt_rad).directions)
        for c in found.common
    )
    return replace(found, common=common), (features[0], upright(features[1], tilt_rad))


def looks_of(panorama: Panorama, variants: Sequence[Variant]) -> dict[Any, Any]:
    """What each way to look keeps of a panorama; several variants may share one."""
    return {look: look(panorama) for look in dict.fromkeys(v.look for v in variants)}


def regions_given(
    a: Features, b: Features, rig: CameraRig, poses: tuple[Pose, Pose], truth: GroundTruth
) -> Comparison:
    """SIFT's matches under one relative pose, grouped by the true landmarks that they lie on in A.

    Generous to SIFT: it need not find out what belongs together.
    """
    config = MatchConfig()
    ia, ib = mutual_matches(a.descriptors, b.descriptors, config.ratio)
    fa, fb = a.take(ia), b.take(ib)
    geometry = estimate(fa.directions, fb.directions, config.min_inliers)
    if geometry is None:
        return Comparison((), None)
    on, _ = truth.look_along(poses[0], fa.bearing_rad, fa.slope, rig)
    claims = []
    for thing in np.unique(on[geometry.inliers]):
        if thing < 0 or not truth.scene.objects[thing].landmark:
            continue
        own = np.flatnonzero(geometry.inliers & (on == thing))
        regions = panorama_region(fa.take(own), rig), panorama_region(fb.take(own), rig)
        claims.append(CommonLandmark(support_score(len(own)), *regions, ia[own], ib[own]))
    return Comparison(tuple(sorted(claims, key=lambda c: -c.score)), geometry)


def summarise(claims: pd.DataFrame, pairs: pd.DataFrame) -> dict[str, dict[str, object]]:
    """The figures of each variant, as docs/reference/definitions.md has them, with 95 % intervals.

    Intervals: bootstrap over suburbs.
    """
    return {
        str(variant): _summary(claims[claims.variant == variant], own)
        for variant, own in pairs.groupby("variant", sort=False)
    }


def _summary(claims: pd.DataFrame, pairs: pd.DataFrame) -> dict[str, object]:
    counting = counted(claims, pairs)
    made = counting[~counting.duplicate.astype(bool)]
    fair, apart = pairs[pairs.co_visible > 0], made[~made.twin.astype(bool)]
    told = Bootstrap(pairs.suburb, "landmarks")
    found: dict[str, object] = {
        **_rates(made, pairs, told),
        **told.mean("precision_without_twins", apart.right, apart.suburb, 1.0),
        "recall_at_precision": {f"{p:.2f}": _recall_at(claims, pairs, p) for p in PRECISIONS},
        "twin_claims": int(made.twin.astype(bool).sum()),
        "duplicates": len(counting) - len(made),
        "quality_m_mean": or_none(made.quality_m.mean()),
        "quality_m_median": or_none(made.quality_m.median()),
        "claims_per_pair": len(made) / len(pairs),
        "ms_per_pair": float(pairs.ms.median()),
    }
    for name in ("heading_error_deg", "direction_error_deg"):
        found[name] = or_none(fair[name].median())
        found[f"{name}_answered"] = or_none((fair[name] < 180.0).mean())
    found["calibration_error"] = (
        expected_calibration_error(made.score.to_numpy(float), made.right.to_numpy(bool))
        if len(made)
        else None
    )
    return found


def counted(claims: pd.DataFrame, pairs: pd.DataFrame) -> pd.DataFrame:
    """The claims of one variant that it makes by its own thresholds."""
    first = claims.score == claims.groupby(_KEY).score.transform("max")
    least, surest = pairs[["claimed", "surest"]].iloc[0]
    return claims[(claims.score >= least) | (first & (claims.score >= surest))]


def _rates(made: pd.DataFrame, pairs: pd.DataFrame, told: Bootstrap) -> dict[str, object]:
    """How many pairs there are, and what became of them; made: the claims that count."""
    surest = made.sort_values("score", ascending=False, kind="stable").groupby(_KEY).right.first()
    of_pair = pd.MultiIndex.from_frame(pairs[_KEY])
    success = pd.Series(surest.reindex(of_pair).eq(True).to_numpy(), pairs.index)
    accused = pd.Series(of_pair.isin(surest.index), pairs.index)
    fair, empty = pairs[pairs.co_visible > 0], pairs[pairs.co_visible == 0]
    shared = told.sums(made.shared, made.suburb)
    return {
        "n_pairs": len(pairs),
        "pairs_without_common": len(empty),
        **told.share("pair_success", success[fair.index], fair.suburb),
        **told.mean("precision", made.right, made.suburb, 1.0),
        **ratio("recall", shared, told.sums(pairs.co_visible, pairs.suburb), told.again, 1.0),
        **told.share("false_claim_rate", accused[empty.index], empty.suburb),
    }


def summarise_survey(claims: pd.DataFrame) -> dict[str, object]:
    """The figures of ``pairs.claims_of``'s table, which is of one scene: without intervals."""
    claims = claims.assign(suburb=0)
    made = claims[claims.score.notna() & ~claims.duplicate.eq(True)]
    pairs = claims.groupby("pair", as_index=False).first()
    rates = _rates(made, pairs, Bootstrap(pairs.suburb, "survey"))
    names = ("n_pairs", "pairs_without_common", "pair_success", "precision", "recall")
    return {
        **{name: rates[name] for name in names},
        "n_claims": len(made),
        "claims_per_pair": len(made) / len(pairs),
        "twin_claims": int(made.twin.astype(bool).sum()),
        "quality_m_mean": float(made.quality_m.mean()),
        "quality_m_median": float(made.quality_m.median()),
    }


def _recall_at(claims: pd.DataFrame, pairs: pd.DataFrame, precision: float) -> float | None:
    """The largest recall of any threshold at which the precision is reached; None: never."""
    sums = from_score(claims)
    held = sums[sums.right / sums.n >= precision]
    return float(held.shared.max() / max(1, pairs.co_visible.sum())) if len(held) else None


def from_score(claims: pd.DataFrame) -> pd.DataFrame:
    """How many claims there are from each score on, falling: n, and right and shared ones of them.

    Claims of one score stand or fall together; a second one on the same two objects is none.
    """
    own = claims.astype({"right": bool, "shared": bool, "duplicate": bool})
    counts = (
        own[~own.duplicate]
        .groupby("score")
        .agg(n=("right", "size"), right=("right", "sum"), shared=("shared", "sum"))
    )
    return counts.sort_index(ascending=False).cumsum()


def as_table(summary: dict[str, dict[str, Any]]) -> pd.DataFrame:
    """The main figures to read: one row a variant, intervals in brackets."""
    columns = {
        "n_pairs": "pairs", "pair_success": "pair_success", "precision": "precision",
        "precision_without_twins": "without_twins",
        "recall": "recall", "false_claim_rate": "false_claim_rate",
        "recall_at_precision": "recall_at_precision", "twin_claims": "twins",
        "quality_m_median": "quality_m", "direction_error_deg": "direction_deg",
        "heading_error_deg": "heading_deg", "direction_error_deg_answered": "answered",
        "calibration_error": "ece", "ms_per_pair": "ms",
    }  # fmt: skip
    table = table_of(summary, list(columns), "variant")
    table["recall_at_precision"] = [
        " ".join(shown(f["recall_at_precision"], p) for p in f["recall_at_precision"])
        for f in summary.values()
    ]
    return table.rename(columns=columns)
