"""How well two robots agree on a landmark, over the distance between them."""

import pandas as pd
from matplotlib.figure import Figure

from vrchain.experiments.results import Results, rig_text
from vrchain.plots.quality import landmark_quality_figure
from vrchain.plots.scripts import run_script


def draw(results: Results) -> tuple[Figure, pd.DataFrame]:
    """Every claim of the random pairs, and what they come to."""
    claims, bands = (results.table("landmarks", name) for name in ("pairs", "pairs_summary"))
    note = f"Random pairs of free places in the suburb, {rig_text(results.profile.fine_rig)}."
    return landmark_quality_figure(claims, bands, note), claims


if __name__ == "__main__":
    run_script(__file__, draw)
