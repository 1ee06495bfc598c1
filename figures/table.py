"""The paper's table and bounds: update, retrieval, landmark quality, ours beside its own."""

import pandas as pd

from vrchain.experiments.reproduction.results import Results
from vrchain.plots.reproduction import TABLE_NOTE, table_figure
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """Table and bounds as a picture; the rows of both, and how times are spread, as numbers."""
    summary, bounds = results.summary(), results.bounds()
    note = f"{TABLE_NOTE}\n{results.note()}"
    figure = table_figure(summary, bounds, results.qualities(), note)
    return figure, pd.concat([summary, bounds, results.statistics()])


if __name__ == "__main__":
    run_script(__file__, draw)
