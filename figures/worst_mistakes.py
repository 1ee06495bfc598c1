"""Where two robots were surest that they see the same, and were wrong."""

import pandas as pd
from matplotlib.figure import Figure

from vrchain.experiments.landmarks.pairs import draw_pairs
from vrchain.experiments.reproduction.results import Results, suburb
from vrchain.landmarks.matching.variants import DEFAULT, variant_named
from vrchain.landmarks.quality import judge
from vrchain.panorama import CameraRig
from vrchain.plots.landmarks import Mistake, mistakes_figure
from vrchain.plots.scripts import run_script
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

SHOWN = 5
SPACING_M = (5.0, 40.0)
LEAST_PAIRS = 6  # fewer may have nothing in common


def draw(results: Results) -> tuple[Figure, pd.DataFrame]:
    """The surest wrong claims of some random pairs of places."""
    rig, renderer, truth = CameraRig(), Renderer(suburb()), GroundTruth(suburb())
    variant, seed = variant_named(DEFAULT), results.profile.seed + 1
    n_pairs = max(LEAST_PAIRS, results.profile.pairs_a_band)
    rows, wrong = [], []
    for a, b in draw_pairs(suburb(), n_pairs, SPACING_M, seed):
        panoramas = renderer.render(a, rig), renderer.render(b, rig)
        looks = [variant.look(panorama) for panorama in panoramas]
        found = variant.compare(*looks)
        keypoints = tuple(variant.keypoints(look) for look in looks)
        verdicts = judge(found, truth, (a, b), keypoints, rig)
        for claim, verdict in zip(found.common, verdicts, strict=True):
            if verdict.duplicate:
                continue
            shows = verdict.object_a, verdict.object_b
            rows.append({"spacing_m": a.distance_to_m(b.xy_m), "score": claim.score,
                         "right": verdict.right, "in_a": shows[0], "in_b": shows[1]})  # fmt: skip
            if not verdict.right:
                wrong.append(Mistake(*panoramas, claim, shows, a.distance_to_m(b.xy_m)))
    table = pd.DataFrame(rows, columns=["spacing_m", "score", "right", "in_a", "in_b"])
    wrong.sort(key=lambda mistake: -mistake.claim.score)
    note = (
        f"Of {len(table)} claims in {n_pairs} pairs, "
        f"{SPACING_M[0]:g}-{SPACING_M[1]:g} m apart, {len(wrong)} are wrong."
    )
    return mistakes_figure(wrong[:SHOWN], note), table


if __name__ == "__main__":
    run_script(__file__, draw)
