"""Where two robots were surest that they see the same landmark, and were wrong."""

from dataclasses import dataclass

import pandas as pd

from vrchain.experiments.landmarks.pairs import draw_pairs
from vrchain.landmarks.matching.common import CommonLandmark
from vrchain.landmarks.matching.variants import DEFAULT, variant_named
from vrchain.landmarks.quality import judge
from vrchain.panorama import CameraRig, Panorama
from vrchain.world.model import Scene
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

COLUMNS = ["spacing_m", "score", "right", "in_a", "in_b"]


@dataclass(frozen=True, eq=False)
class Mistake:
    """A wrong claim: the two panoramas, the claim, and what its regions truly show."""

    a: Panorama
    b: Panorama
    claim: CommonLandmark
    shows: tuple[str, str]
    spacing_m: float


def judged_claims(
    scene: Scene, n_pairs: int, spacing_m: tuple[float, float], seed: int
) -> tuple[pd.DataFrame, list[Mistake]]:
    """Claims in random pairs of places, by the default variant, and the wrong ones, surest first.

    One row a claim, duplicates aside: spacing_m, score, right, and what it shows in each view.
    """
    rig, renderer, truth = CameraRig(), Renderer(scene), GroundTruth(scene)
    variant = variant_named(DEFAULT)
    rows, wrong = [], []
    for a, b in draw_pairs(scene, n_pairs, spacing_m, seed):
        apart_m = a.distance_to_m(b.xy_m)
        panoramas = renderer.render(a, rig), renderer.render(b, rig)
        look_a, look_b = (variant.look(panorama) for panorama in panoramas)
        found = variant.compare(look_a, look_b)
        keypoints = variant.keypoints(look_a), variant.keypoints(look_b)
        verdicts = judge(found, truth, (a, b), keypoints, rig)
        for claim, verdict in zip(found.common, verdicts, strict=True):
            if verdict.duplicate:
                continue
            shows = verdict.object_a, verdict.object_b
            rows.append((apart_m, claim.score, verdict.right, *shows))
            if not verdict.right:
                wrong.append(Mistake(*panoramas, claim, shows, apart_m))
    wrong.sort(key=lambda mistake: -mistake.claim.score)
    return pd.DataFrame(rows, columns=COLUMNS), wrong
