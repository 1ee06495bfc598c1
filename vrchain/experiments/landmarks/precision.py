"""How well two robots agree on what both see: precision, recall and pose, by variant.

Pairs of poses in suburb after suburb, about ten in each; each suburb's claims are saved as they
come, so that a run broken off goes on with the next.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import MissionError
from vrchain.experiments.intervals import resampled, share, sums
from vrchain.experiments.landmarks.pairs import draw_pairs, draw_poses
from vrchain.experiments.scenes import Scenes
from vrchain.files import code_digest, name_of, write_file
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.sift import Features, mutual_matches
from vrchain.landmarks.matching.common import (
    CommonLandmark,
    Comparison,
    MatchConfig,
    panorama_region,
    support_score,
)
from vrchain.landmarks.matching.epipolar import estimate
from vrchain.landmarks.matching.variants import DEFAULT, Variant, sift, variant_named
from vrchain.landmarks.quality import co_visible, judge, names_in_common
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator
from vrchain.world.model import Scene
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

PAIRS_A_SUBURB = 10
LEAST_SCORE = 0.02  # claims are kept from here on, to see what other thresholds would do
GIVEN = "sift, regions given"
ROWS = ("sift", GIVEN, "cnn", DEFAULT)


def row(name: str) -> Variant:
    """The variant of a table's row, with all its claims that are worth keeping."""
    if name == GIVEN:
        return replace(sift(LEAST_SCORE), name=GIVEN)
    return variant_named(name, LEAST_SCORE)


def evaluate(
    scenes: Scenes,
    n_pairs: int,
    spacing_m: tuple[float, float],
    variants: Sequence[Variant],
    *,
    seed: int,
    folder: Path,
    rig: CameraRig | None = None,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Claims and pairs of ``n_pairs`` random pairs, one row each (see ``_suburb``).

    suburb: in a world that stays as it is, each pair has a number of its own: intervals are over
    pairs there. What was found already under ``folder`` is read from there.
    """
    if n_pairs < 1 or not 0 < spacing_m[0] <= spacing_m[1] < np.inf:
        raise MissionError(
            f"expected 1 pair or more and 0 < MIN <= MAX metres, got {n_pairs} and {spacing_m}"
        )
    rig = rig or CameraRig()
    own = _own_folder(folder, scenes, list(spacing_m), variants, seed, rig)
    suburbs = -(-n_pairs // PAIRS_A_SUBURB)
    claims, pairs = [], []
    for k in tqdm(range(suburbs), desc="suburbs", unit="", disable=None):
        n = min(PAIRS_A_SUBURB, n_pairs - k * PAIRS_A_SUBURB)
        file = own / f"suburb_{k:04d}_{n}.json"
        if not file.exists():
            found = _suburb(scenes.scene(seed, k), n, spacing_m, variants, seed, k, rig)
            write_file(file, json.dumps(found).encode())
        stored = json.loads(file.read_text())
        claims += [{"suburb": k, **row} for row in stored["claims"]]
        pairs += [{"suburb": k, **row} for row in stored["pairs"]]
    table, made = pd.DataFrame(pairs), pd.DataFrame(claims, columns=["suburb", *_CLAIM])
    if not scenes.varied:
        made, table = (t.assign(suburb=t.suburb * PAIRS_A_SUBURB + t.pair) for t in (made, table))
    return made, table


def _own_folder(
    folder: Path, scenes: Scenes, what: list, variants: Sequence[Variant], seed: int, rig: CameraRig
) -> Path:
    """Where what was found of just this is kept. MissionError for two variants of one name."""
    if len({v.name for v in variants}) < len(variants):
        raise MissionError(
            f"expected variants of different names, got {', '.join(v.name for v in variants)}: "
            "their results could not be told apart"
        )
    made_by = [(v.name, v.maker) for v in variants]
    asked = [code_digest(), scenes.digest, what, made_by, seed, asdict(rig)]
    return folder / name_of(asked)


_CLAIM = (
    "pair", "variant", "score", "right", "shared", "twin", "duplicate", "quality_m", "support",
    "object_a", "object_b",
)  # fmt: skip


def _suburb(
    scene: Scene,
    n_pairs: int,
    spacing_m: tuple[float, float],
    variants: Sequence[Variant],
    seed: int,
    k: int,
    rig: CameraRig,
) -> dict[str, list[dict[str, object]]]:
    """Claims and pairs of one suburb, a row each.

    Claims: pair, variant, score, right, shared (right, and the landmark co-visible), twin,
    duplicate, quality_m, support, object_a, object_b. Pairs: pair, variant, claimed (the score from
    which a claim counts), spacing_m, co_visible, ms, direction_error_deg and heading_error_deg
    (180: no answer).
    """
    renderer, truth = Renderer(scene), GroundTruth(scene)
    poses = list(draw_pairs(scene, n_pairs, spacing_m, seed * 100_003 + k))
    claims: list[dict[str, object]] = []
    pairs: list[dict[str, object]] = []
    for number, (a, b) in enumerate(poses):
        first, second = (_look(renderer.render(pose, rig), variants) for pose in (a, b))
        shared = names_in_common(truth, a, b, rig)
        for variant in variants:
            look_a, look_b = first[variant.look], second[variant.look]
            features = variant.keypoints(look_a), variant.keypoints(look_b)
            start = perf_counter()
            if variant.name == GIVEN:
                found = regions_given(*features, rig, (a, b), truth)
            else:
                found = variant.compare(look_a, look_b)
            ms = (perf_counter() - start) * 1e3
            for claim, verdict in zip(
                found.common, judge(found, truth, (a, b), features, rig), strict=True
            ):
                claims.append(
                    {
                        "pair": number,
                        "variant": variant.name,
                        "score": claim.score,
                        "right": verdict.right,
                        "shared": verdict.right and verdict.object_a in shared,
                        "twin": verdict.twin,
                        "duplicate": verdict.duplicate,
                        "quality_m": verdict.quality_m,
                        "support": len(claim.support_a),
                        "object_a": verdict.object_a,
                        "object_b": verdict.object_b,
                    }
                )
            direction, heading = _pose_errors_deg(found, a, b)
            pairs.append(
                {
                    "pair": number,
                    "variant": variant.name,
                    "claimed": variant.claimed,
                    "spacing_m": a.distance_to_m(b.xy_m),
                    "co_visible": len(shared),
                    "ms": ms,
                    "direction_error_deg": direction,
                    "heading_error_deg": heading,
                }
            )
    return {"claims": claims, "pairs": pairs}


def _look(panorama: Panorama, variants: Sequence[Variant]) -> dict[Any, Any]:
    """What each way to look keeps of a panorama; several variants may share one."""
    return {look: look(panorama) for look in dict.fromkeys(v.look for v in variants)}


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
    own = _own_folder(folder, scenes, ["strangers"], variants, seed, rig)
    wanted = {False: n_pairs - n_pairs // 2, True: n_pairs // 2}
    made: dict[bool, list[dict[str, object]]] = {False: [], True: []}
    before: _Seen | None = None
    with tqdm(total=n_pairs, desc="pairs of strangers", unit="", disable=None) as progress:
        for k in range(10 * n_pairs):
            if all(len(made[two]) >= wanted[two] * len(variants) for two in made):
                break
            file = own / f"suburb_{k:04d}.json"
            if not file.exists():
                if k and before is None:
                    before = _seen(scenes, variants, seed, k - 1, rig)
                here = _seen(scenes, variants, seed, k, rig)
                write_file(file, json.dumps(_strangers_of(here, before, variants)).encode())
                before = here
            else:
                before = None
            for row in json.loads(file.read_text()):
                two = row["two_suburbs"]
                if len(made[two]) < wanted[two] * len(variants):
                    made[two].append({"suburb": k, **row})
            progress.update(sum(map(len, made.values())) // len(variants) - progress.n)
    return pd.DataFrame([*made[False], *made[True]])


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is made of a suburb's panoramas, and which two of them have nothing in common."""

    looks: list[dict[Any, Any]]
    apart: list[tuple[int, int]]


def _seen(scenes: Scenes, variants: Sequence[Variant], seed: int, k: int, rig: CameraRig) -> _Seen:
    scene = scenes.scene(seed, k)
    renderer, truth = Renderer(scene), GroundTruth(scene)
    poses = draw_poses(scene, PAIRS_A_SUBURB, generator(seed, "strangers", k))
    looks = [_look(renderer.render(pose, rig), variants) for pose in poses]
    apart = [
        (i, j)
        for i, j in combinations(range(len(poses)), 2)
        if not co_visible(truth, poses[i], poses[j], rig)
    ]
    return _Seen(looks, apart)


def _strangers_of(
    here: _Seen, before: _Seen | None, variants: Sequence[Variant]
) -> list[dict[str, object]]:
    """Rows of pairs within a suburb, and of pairs with the suburb before, as many at most."""
    pairs = [(False, here.looks[i], here.looks[j]) for i, j in here.apart[:PAIRS_A_SUBURB]]
    if before is not None:
        pairs += [(True, a, b) for a, b in zip(before.looks, here.looks, strict=True)]
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
        suburbs = np.unique(own.suburb)
        again = resampled(len(suburbs), 0, "strangers")
        told = share("claimed", *sums(own.score > 0, own.suburb, suburbs), again)
        rows.append({"variant": variant, "two_suburbs": two, "pairs": len(own), **told})
    return pd.DataFrame(rows)


def regions_given(
    a: Features, b: Features, rig: CameraRig, poses: tuple[Pose, Pose], truth: GroundTruth
) -> Comparison:
    """SIFT's matches under one relative pose, grouped by the true landmarks that they lie on in A.

    Generous to SIFT: it need not find out what belongs together.
    """
    config = MatchConfig()
    ia, ib = mutual_matches(a.descriptors, b.descriptors, config.ratio)
    fa, fb = a.take(ia), b.take(ib)
    geometry = estimate(fa.bearing_rad, fa.slope, fb.bearing_rad, fb.slope, config.min_inliers)
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


def _pose_errors_deg(found: Comparison, a: Pose, b: Pose) -> tuple[float, float]:
    if found.geometry is None:
        return 180.0, 180.0
    direction = found.geometry.direction_rad - a.bearing_to_rad(b.xy_m)
    heading = found.geometry.heading_rad - (b.yaw_rad - a.yaw_rad)
    off = np.degrees(np.abs(wrap_angle_rad(np.array([direction, heading]))))
    return float(off[0]), float(off[1])
