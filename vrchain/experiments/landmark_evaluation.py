"""How well two robots agree on what both see: precision, recall and pose, by variant.

Pairs of poses in suburb after suburb, about ten in each; each suburb's claims are saved as they
come, so that a run broken off goes on with the next.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from tqdm.auto import tqdm

from vrchain.errors import MissionError
from vrchain.experiments.landmarks import draw_pairs
from vrchain.files import write_file
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.calibration import expected_calibration_error
from vrchain.landmarks.common import (
    CommonLandmark,
    Comparison,
    MatchConfig,
    compare,
    panorama_region,
    support_score,
)
from vrchain.landmarks.epipolar import estimate
from vrchain.landmarks.joint import JointConfig, compare_joint
from vrchain.landmarks.quality import co_visible, judge
from vrchain.landmarks.record import LandmarkRecord, examine, maker_of
from vrchain.landmarks.sift import Features, extract, mutual_matches
from vrchain.panorama import CameraRig, Panorama
from vrchain.render import Renderer
from vrchain.scene import build_scene
from vrchain.scene.spec import SceneSpec
from vrchain.seeding import generator
from vrchain.truth import GroundTruth

FORMAT = 1
PAIRS_A_SUBURB = 10
LEAST_SCORE = 0.02  # claims are kept from here on, to see what other thresholds would do
DEFAULT_SCORE = 0.5
PRECISIONS = (0.90, 0.95, 0.98)
GIVEN = "sift, regions given"
ROWS = ("sift", GIVEN, "cnn", "cnn+sift")
_RESAMPLED = 1000


def suburb_of(spec: SceneSpec, seed: int, k: int) -> SceneSpec:
    """Suburb ``k`` of a seed: the spec with a seed of its own, from the pair."""
    return replace(spec, seed=int(generator(seed, "suburb", k).integers(2**31)))


def evaluate(
    spec: SceneSpec,
    n_pairs: int,
    spacing_m: tuple[float, float],
    variants: Sequence[str] = ROWS,
    *,
    seed: int,
    folder: Path,
    rig: CameraRig | None = None,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Claims and pairs of ``n_pairs`` random pairs, one row each (see ``_suburb``).

    What was found already under ``folder`` is read from there.
    """
    if n_pairs < 1 or not 0 < spacing_m[0] <= spacing_m[1] < np.inf:
        raise MissionError(
            f"expected 1 pair or more and 0 < MIN <= MAX metres, got {n_pairs} and {spacing_m}"
        )
    unknown = set(variants) - set(ROWS)
    if unknown:
        raise MissionError(f"no variant {', '.join(sorted(unknown))}: there are {', '.join(ROWS)}")
    rig = rig or CameraRig()
    maker = maker_of() if any(v.startswith("cnn") for v in variants) else None
    asked = [FORMAT, asdict(spec), list(spacing_m), list(variants), seed, asdict(rig), maker]
    own = folder / hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()[:12]
    suburbs = -(-n_pairs // PAIRS_A_SUBURB)
    claims, pairs = [], []
    for k in tqdm(range(suburbs), desc="suburbs", unit="", disable=None):
        file = own / f"suburb_{k:04d}.json"
        if not file.exists():
            found = _suburb(suburb_of(spec, seed, k), spacing_m, variants, seed, k, rig)
            write_file(file, json.dumps(found).encode())
        stored = json.loads(file.read_text())
        claims += [{"suburb": k, **row} for row in stored["claims"]]
        pairs += [{"suburb": k, **row} for row in stored["pairs"]]
    table = pd.DataFrame(pairs)
    table = table[table.groupby("variant").cumcount() < n_pairs]
    made = pd.DataFrame(claims, columns=["suburb", *_CLAIM])
    drawn = table[["suburb", "pair"]].drop_duplicates()
    return made.merge(drawn, on=["suburb", "pair"]), table


_CLAIM = (
    "pair", "variant", "score", "right", "shared", "twin", "duplicate", "quality_m", "support",
    "object_a", "object_b",
)  # fmt: skip


def _suburb(
    spec: SceneSpec,
    spacing_m: tuple[float, float],
    variants: Sequence[str],
    seed: int,
    k: int,
    rig: CameraRig,
) -> dict[str, list[dict[str, object]]]:
    """Claims and pairs of one suburb, a row each.

    Claims: pair, variant, score, right, shared (right, and the landmark co-visible), twin,
    duplicate, quality_m, support, object_a, object_b. Pairs: pair, variant, spacing_m, co_visible,
    ms, direction_error_deg and heading_error_deg (180: no answer).
    """
    scene = build_scene(spec)
    renderer, truth = Renderer(scene), GroundTruth(scene)
    poses = list(draw_pairs(scene, PAIRS_A_SUBURB, spacing_m, seed * 100_003 + k))
    claims: list[dict[str, object]] = []
    pairs: list[dict[str, object]] = []
    for number, (a, b) in enumerate(poses):
        first, second = (_look(renderer.render(pose, rig), variants) for pose in (a, b))
        shared = {scene.objects[i].name for i in co_visible(truth, a, b, rig)}
        for variant in variants:
            start = perf_counter()
            if variant == GIVEN:
                found = regions_given(first.whole, second.whole, rig, (a, b), truth)
            else:
                found = _compare(variant, first, second, rig)
            ms = (perf_counter() - start) * 1e3
            features = first.features(variant), second.features(variant)
            for claim, verdict in zip(
                found.common, judge(found, truth, (a, b), features, rig), strict=True
            ):
                claims.append(
                    {
                        "pair": number,
                        "variant": variant,
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
                    "variant": variant,
                    "spacing_m": a.distance_to_m(b.xy_m),
                    "co_visible": len(shared),
                    "ms": ms,
                    "direction_error_deg": direction,
                    "heading_error_deg": heading,
                }
            )
    return {"claims": claims, "pairs": pairs}


@dataclass(frozen=True, eq=False)
class _Look:
    """What the variants are given of one panorama: its keypoints, all of them, and its record."""

    whole: Features
    record: LandmarkRecord | None

    def features(self, variant: str) -> Features:
        """The keypoints that a variant's claims count by."""
        return self.record.features if self.record and variant.startswith("cnn") else self.whole


def _look(panorama: Panorama, variants: Sequence[str]) -> _Look:
    learned = any(v.startswith("cnn") for v in variants)
    return _Look(extract(panorama), examine(panorama) if learned else None)


def _compare(variant: str, a: _Look, b: _Look, rig: CameraRig) -> Comparison:
    if variant == "sift":
        return compare(a.whole, b.whole, rig, MatchConfig(min_score=LEAST_SCORE))
    assert a.record is not None and b.record is not None
    config = JointConfig(sift=variant == "cnn+sift", min_score=LEAST_SCORE)
    return compare_joint(a.record, b.record, config)


def strangers(
    spec: SceneSpec,
    n_pairs: int,
    variants: Sequence[str],
    *,
    seed: int,
    rig: CameraRig | None = None,
) -> pd.DataFrame:
    """Pairs with nothing in common, half of one suburb, half of two: one row a pair and variant.

    Columns: pair, variant, two_suburbs, score (of the surest claim, 0 without any).
    """
    rig = rig or CameraRig()
    rows: list[dict[str, object]] = []
    before: list[_Look] = []
    made = {False: 0, True: 0}
    wanted = {False: n_pairs - n_pairs // 2, True: n_pairs // 2}
    with tqdm(total=n_pairs, desc="pairs of strangers", unit="", disable=None) as progress:
        for k in range(10 * n_pairs):
            if made == wanted:
                break
            scene = build_scene(suburb_of(spec, seed, k))
            renderer, truth = Renderer(scene), GroundTruth(scene)
            draws = generator(seed, "strangers", k)
            half = np.array(scene.extent_m) / 2
            poses: list[Pose] = []
            while len(poses) < PAIRS_A_SUBURB:
                place = draws.uniform(-half, half)
                if scene.is_free([place]).all():
                    poses.append(Pose(*map(float, (*place, draws.uniform(-np.pi, np.pi)))))
            looks = [_look(renderer.render(pose, rig), variants) for pose in poses]
            pairs = [
                (False, looks[i], looks[j])
                for i, j in combinations(range(len(poses)), 2)
                if not co_visible(truth, poses[i], poses[j], rig)
            ]
            pairs += [(True, a, b) for a, b in zip(before, looks, strict=False)]
            for two, a, b in pairs[: 2 * PAIRS_A_SUBURB]:
                if made[two] >= wanted[two]:
                    continue
                for variant in variants:
                    claims = _compare(variant, a, b, rig).common
                    score = max((c.score for c in claims), default=0.0)
                    rows.append({"pair": sum(made.values()), "variant": variant,
                                 "two_suburbs": two, "score": score})  # fmt: skip
                made[two] += 1
                progress.update()
            before = looks
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


def summarise(
    claims: pd.DataFrame, pairs: pd.DataFrame, *, seed: int = 0, score: float = DEFAULT_SCORE
) -> dict[str, dict[str, object]]:
    """The figures of each variant, as docs/definitions.md has them, with 95 % intervals.

    Intervals: bootstrap over suburbs.
    """
    return {
        str(variant): _summary(claims[claims.variant == variant], own, seed, score)
        for variant, own in pairs.groupby("variant", sort=False)
    }


def _summary(
    claims: pd.DataFrame, pairs: pd.DataFrame, seed: int, score: float
) -> dict[str, object]:
    made = claims[(claims.score >= score) & ~claims.duplicate.astype(bool)]
    fair = pairs[pairs.co_visible > 0]
    key = ["suburb", "pair"]
    best = made.sort_values("score", ascending=False, kind="stable").groupby(key).first()
    success = best.right.reindex(pd.MultiIndex.from_frame(fair[key])).eq(True).to_numpy()
    claimed = made.groupby(key).size()
    empty = pairs[pairs.co_visible == 0]
    accused = claimed.reindex(pd.MultiIndex.from_frame(empty[key])).notna().to_numpy()
    suburbs = np.sort(pairs.suburb.unique())

    def by_suburb(values: pd.Series, of: pd.Series) -> NDArray[np.float64]:
        return np.asarray(values.groupby(of).sum().reindex(suburbs).fillna(0), dtype=float)

    one = pd.Series(1.0, index=made.index)
    ratios = {
        "pair_success": (by_suburb(pd.Series(success, index=fair.index), fair.suburb),
                         by_suburb(pd.Series(1.0, index=fair.index), fair.suburb)),
        "precision": (by_suburb(made.right.astype(float), made.suburb),
                      by_suburb(one, made.suburb)),
        "recall": (by_suburb(made.shared.astype(float), made.suburb),
                   by_suburb(pairs.co_visible.astype(float), pairs.suburb)),
        "false_claim_rate": (by_suburb(pd.Series(accused, index=empty.index), empty.suburb),
                             by_suburb(pd.Series(1.0, index=empty.index), empty.suburb)),
    }  # fmt: skip
    draws = generator(seed, "bootstrap", "landmarks")
    again = draws.integers(len(suburbs), size=(_RESAMPLED, len(suburbs)))
    found: dict[str, object] = {
        "n_pairs": len(pairs),
        "pairs_without_common": len(empty),
    }
    for name, (top, bottom) in ratios.items():
        found[name] = float(top.sum() / bottom.sum()) if bottom.sum() else None
        under = bottom[again].sum(axis=1)
        shares = top[again].sum(axis=1)[under > 0] / under[under > 0]
        found[f"{name}_ci"] = (
            [float(q) for q in np.quantile(shares, [0.025, 0.975])] if len(shares) else None
        )
    found["recall_at_precision"] = {f"{p:.2f}": _recall_at(claims, pairs, p) for p in PRECISIONS}
    found["twin_claims"] = int(made.twin.astype(bool).sum())
    found["duplicates"] = int((claims.score >= score).sum() - len(made))
    found["quality_m_mean"] = _or_none(made.quality_m.mean())
    found["quality_m_median"] = _or_none(made.quality_m.median())
    found["claims_per_pair"] = len(made) / len(pairs)
    found["ms_per_pair"] = float(pairs.ms.median())
    for name in ("heading_error_deg", "direction_error_deg"):
        found[name] = _or_none(fair[name].median())
        found[f"{name}_answered"] = _or_none((fair[name] < 180.0).mean())
    found["calibration_error"] = _calibration_error(made)
    return found


def _recall_at(claims: pd.DataFrame, pairs: pd.DataFrame, precision: float) -> float | None:
    """The largest recall of any threshold at which the precision is reached; None: never."""
    ordered = claims[~claims.duplicate.astype(bool)].sort_values("score", ascending=False)
    if len(ordered) == 0:
        return None
    right = ordered.right.astype(float).to_numpy().cumsum()
    held = right / np.arange(1, len(ordered) + 1) >= precision
    if not held.any():
        return None
    shared = ordered.shared.astype(float).to_numpy().cumsum()
    return float(shared[held].max() / max(1, pairs.co_visible.sum()))


def _calibration_error(made: pd.DataFrame) -> float | None:
    if len(made) == 0:
        return None
    right = made.right.to_numpy(dtype=bool)
    return expected_calibration_error(made.score.to_numpy(dtype=float), right)


def _or_none(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def as_table(summary: dict[str, dict[str, object]]) -> pd.DataFrame:
    """The main figures to read: one row a variant, intervals in brackets."""

    def shown(figures: dict[str, object], name: str) -> str:
        value, interval = figures[name], figures.get(f"{name}_ci")
        if not isinstance(value, float):
            return "-"
        ends = f" [{interval[0]:.3f}, {interval[1]:.3f}]" if isinstance(interval, list) else ""
        return f"{value:.3f}{ends}"

    names = ("pair_success", "precision", "recall", "false_claim_rate")
    rows = {}
    for variant, figures in summary.items():
        rows[variant] = {
            "pairs": figures["n_pairs"],
            **{name: shown(figures, name) for name in names},
            "recall_at_precision": " ".join(
                "-" if v is None else f"{v:.3f}"
                for v in dict(figures["recall_at_precision"]).values()  # type: ignore[call-overload]
            ),
            "twins": figures["twin_claims"],
            "quality_m": shown(figures, "quality_m_median"),
            "direction_deg": shown(figures, "direction_error_deg"),
            "heading_deg": shown(figures, "heading_error_deg"),
            "answered": shown(figures, "direction_error_deg_answered"),
            "ece": shown(figures, "calibration_error"),
            "ms": shown(figures, "ms_per_pair"),
        }
    return pd.DataFrame(rows).T.rename_axis("variant")
