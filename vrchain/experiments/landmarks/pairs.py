"""Pairs of poses to compare, and the claims of common landmarks of any pairs, judged by truth."""

import math
from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from vrchain.errors import MissionError
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.matching.common import Comparison, compare
from vrchain.landmarks.quality import judge, names_in_common
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world.model import Scene
from vrchain.world.truth import GroundTruth

_TRIES = 1000
_COLUMNS = [
    "pair", "spacing_m", "co_visible", "score", "right", "shared", "duplicate", "twin", "quality_m",
    "support", "object",
]  # fmt: skip


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
) -> pd.DataFrame:
    """Claims of common landmarks for pairs of looks, one row a claim.

    Columns: pair, spacing_m, co_visible (landmarks both poses see, by truth), score, right, shared
    (right, and the landmark co-visible), duplicate, twin, quality_m, support, object. A pair
    without a claim has one row, NaN from score on.
    """
    rows: list[dict[str, object]] = []
    for number, (a, b) in enumerate(looks):
        poses, features = (a.pose, b.pose), (a.features, b.features)
        found = compare(*features, rig)
        shared = names_in_common(truth, *poses, rig)
        spacing_m = a.pose.distance_to_m(b.pose.xy_m)
        pair: dict[str, object] = {
            "pair": number,
            "spacing_m": spacing_m,
            "co_visible": len(shared),
        }
        made = judged(found, truth, poses, features, rig, shared, (a.robots, b.robots))
        rows += [pair | claim for claim in made] or [pair]
    return pd.DataFrame(rows).rename(columns={"object_a": "object"}).reindex(columns=_COLUMNS)


def judged(
    found: Comparison,
    truth: GroundTruth,
    poses: tuple[Pose, Pose],
    features: tuple[Features, Features],
    rig: CameraRig | tuple[CameraRig, CameraRig],
    shared: Set[str],
    robots: tuple[Mapping[str, Pose], Mapping[str, Pose]] = ({}, {}),
) -> list[dict[str, object]]:
    """A row for each claim: its score and support, and its ``Verdict``.

    shared: the landmarks that are co-visible, by name; the others as ``judge`` has them.
    """
    return [
        {
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
        for claim, verdict in zip(
            found.common, judge(found, truth, poses, features, rig, robots), strict=True
        )
    ]


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
    """Pairs of free poses: places uniform, spacing uniform in the band, headings independent.

    MissionError for a band that is none, or where the scene has too few free places so far apart.
    """
    try:
        low_m, high_m = map(float, spacing_m)
    except (TypeError, ValueError):
        low_m, high_m = math.nan, math.nan
    if not 0 <= low_m <= high_m:
        raise MissionError(
            f"expected a spacing from low to high, in metres, such as (5, 10), got {spacing_m!r}"
        )
    draws = generator(seed, "pairs")
    half = np.array(scene.extent_m) / 2
    made = 0
    for _ in range(10_000 * n_pairs):
        first = draws.uniform(-half, half)
        spacing, course = draws.uniform(low_m, high_m), draws.uniform(-np.pi, np.pi)
        second = first + spacing * np.array([np.cos(course), np.sin(course)])
        yaws = draws.uniform(-np.pi, np.pi, 2)
        if not scene.is_free([first, second]).all():
            continue
        a, b = (Pose(*map(float, (*p, yaw))) for p, yaw in zip((first, second), yaws, strict=True))
        yield a, b
        made += 1
        if made == n_pairs:
            return
    raise MissionError(
        f"found only {made} of {n_pairs} pairs of free places {low_m:g} to {high_m:g} m apart"
    )
