"""Where two robots were surest that they see the same, and were wrong."""

from vrchain.experiments.landmarks.mistakes import judged_claims
from vrchain.experiments.reproduction.results import Results, suburb
from vrchain.plots.landmarks import mistakes_figure
from vrchain.plots.scripts import Drawn, run_script

SHOWN = 5
SPACING_M = (5.0, 40.0)
LEAST_PAIRS = 6  # fewer may have nothing in common


def draw(results: Results) -> Drawn:
    """The surest wrong claims of some random pairs of places."""
    n_pairs = max(LEAST_PAIRS, results.profile.pairs_a_band)
    table, wrong = judged_claims(suburb(), n_pairs, SPACING_M, results.profile.seed + 1)
    note = (
        f"Of {len(table)} claims in {n_pairs} pairs, "
        f"{SPACING_M[0]:g}-{SPACING_M[1]:g} m apart, {len(wrong)} are wrong."
    )
    return mistakes_figure(wrong[:SHOWN], note), table


if __name__ == "__main__":
    run_script(__file__, draw)
