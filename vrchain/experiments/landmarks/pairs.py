"""How many common landmarks two robots find, how many of them are right, and how well placed."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from vrchain.errors import MissionError
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.matching.common import MatchConfig, compare
from vrchain.landmarks.quality import judge, names_in_common
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world.model import Scene
from vrchain.world.truth import GroundTruth

_TRIES = 1000
_PAIR = ["pair", "spacing_m", "co_visible"]
_CLAIM = ["score", "right", "shared", "duplicate", "twin", "quality_m", "support", "object"]
_COLUMNS = [*_PAIR, *_CLAIM]


@dataclass(frozen=True, eq=False)
class Look:
    """The features of a panorama, the true pose it was taken from, and the robots it may show."""

    pose: Pose
    features: Features
    robots: Mapping[str, Pose] = field(default_factory=dict)


def claims_of(
    looks: Iterable[tuple[Look, Look]],
    truth: GroundTruth,
    rig: CameraRig,
    config: MatchConfig | None = None,
) -> pd.DataFrame:
    """Claims of common landmarks for pairs of looks, one row a claim.

    Columns: pair, spacing_m, co_visible (landmarks both poses see, by truth), score, right, shared
    (right, and the landmark co-visible), duplicate, twin, quality_m, support, object. A pair
    without a claim has one row, NaN from score on.
    """
    rows: list[dict[str, object]] = []
    for number, (a, b) in enumerate(looks):
        poses, features = (a.pose, b.pose), (a.features, b.features)
        comparison = compare(*features, rig, config)
        spacing_m = a.pose.distance_to_m(b.pose.xy_m)
        shared = names_in_common(truth, *poses, rig)
        pair: dict[str, object] = {
            "pair": number,
            "spacing_m": spacing_m,
            "co_visible": len(shared),
        }
        verdicts = judge(comparison, truth, poses, features, rig, (a.robots, b.robots))
        for claim, verdict in zip(comparison.common, verdicts, strict=True):
            rows.append(
                pair
                | {
                    "score": claim.score,
                    "right": verdict.right,
                    "shared": verdict.right and verdict.object_a in shared,
                    "duplicate": verdict.duplicate,
                    "twin": verdict.twin,
                    "quality_m": verdict.quality_m,
                    "support": len(claim.support_a),
                    "object": verdict.object_a,
                }
            )
        if not verdicts:
            rows.append(pair)
    return pd.DataFrame(rows, columns=_COLUMNS)


def summarise(claims: pd.DataFrame) -> dict[str, float]:
    """pair_success, precision, recall and quality of ``claims_of``'s table.

    A second claim on one object pair is a duplicate and counts for nothing.
    """
    made = claims[claims.score.notna() & ~claims.duplicate.eq(True)]
    pairs = claims.groupby("pair").first()
    fair = pairs[pairs.co_visible > 0]
    best = made.sort_values("score", ascending=False, kind="stable").groupby("pair").first()
    best_right = best.right.reindex(fair.index).eq(True)
    right = made.right.astype(bool)
    return {
        "n_pairs": len(pairs),
        "pairs_without_common": int((pairs.co_visible == 0).sum()),
        "pair_success": float(best_right.mean()),
        "precision": float(right.mean()) if len(made) else float("nan"),
        "recall": float(made.shared.astype(bool).sum() / max(1, pairs.co_visible.sum())),
        "n_claims": len(made),
        "claims_per_pair": len(made) / max(1, len(pairs)),
        "twin_claims": int(made.twin.astype(bool).sum()),
        "quality_m_mean": float(made.quality_m.mean()),
        "quality_m_median": float(made.quality_m.median()),
    }


def draw_poses(scene: Scene, n: int, draws: np.random.Generator) -> list[Pose]:
    """Free poses: places uniform, any heading. MissionError if there is no room for them."""
    half, found = np.array(scene.extent_m) / 2, list[Pose]()
    for _ in range(_TRIES * n):
        place = draws.uniform(-half, half)
        if scene.is_free([place]).all():
            found.append(Pose(*map(float, (*place, draws.uniform(-np.pi, np.pi)))))
        if len(found) == n:
            return found
    raise MissionError(f"found only {len(found)} of {n} free places in {scene.name!r}")


def draw_pairs(
    scene: Scene, n_pairs: int, spacing_m: tuple[float, float], seed: int
) -> Iterator[tuple[Pose, Pose]]:
    """Pairs of free poses: places uniform, spacing uniform in the band, headings independent."""
    draws = generator(seed, "pairs")
    half = np.array(scene.extent_m) / 2
    made = 0
    for _ in range(10_000 * n_pairs):
        first = draws.uniform(-half, half)
        spacing, course = draws.uniform(*spacing_m), draws.uniform(-np.pi, np.pi)
        second = first + spacing * np.array([np.cos(course), np.sin(course)])
        yaws = draws.uniform(-np.pi, np.pi, 2)
        if not scene.is_free([first, second]).all():
            continue
        a, b = (Pose(*map(float, (*p, yaw))) for p, yaw in zip((first, second), yaws, strict=True))
        yield a, b
        made += 1
        if made == n_pairs:
            return
    raise MissionError(f"found only {made} of {n_pairs} pairs of free places {spacing_m} m apart")
