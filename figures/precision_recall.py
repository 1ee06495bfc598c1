"""Precision against recall of common landmarks, as the threshold for a claim moves."""

from vrchain.experiments.landmarks.over_distance import precision_recall
from vrchain.experiments.reproduction.results import Results
from vrchain.plots.landmarks import precision_recall_figure
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """A line for each variant, a panel for each band of distances."""
    claims, pairs = (results.table("landmarks", name) for name in ("pairs", "pairs_drawn"))
    curves = precision_recall(claims, pairs)
    note = f"{results.profile.pairs_a_band} random pairs of places in each band."
    return precision_recall_figure(curves, note), curves


if __name__ == "__main__":
    run_script(__file__, draw)
