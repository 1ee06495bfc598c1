"""Retrieval three ways: each over its position, and the means, beside the paper's."""

import pandas as pd

from vrchain.experiments.reproduction.results import Results
from vrchain.plots.reproduction import retrieval_time_figure
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """One row a retrieval, for each way and number of positions."""
    retrievals = results.retrievals()
    return retrieval_time_figure(retrievals, results.note()), pd.concat(retrievals.values())


if __name__ == "__main__":
    run_script(__file__, draw)
