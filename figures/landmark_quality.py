"""Common landmarks over the distance between two robots: how many, how right, how well placed."""

from vrchain.experiments.reproduction.results import Results, rig_text
from vrchain.plots.landmarks import landmark_quality_figure
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """What the claims of random pairs of places come to, by variant."""
    bands = results.table("landmarks", "pairs_summary")
    suburbs = bands.suburbs.max()
    where = f"{suburbs} suburbs (lines: 95 % intervals over them)" if suburbs > 1 else "one suburb"
    note = f"Random pairs of free places in {where}, {rig_text(results.profile.fine_rig)}."
    return landmark_quality_figure(bands, note), bands


if __name__ == "__main__":
    run_script(__file__, draw)
