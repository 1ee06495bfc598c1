"""The paper's table: update, retrieval, landmark quality, measured here and as printed there."""

import pandas as pd
from matplotlib.figure import Figure

from vrchain.experiments.results import Results
from vrchain.plots.latency import TABLE_NOTE, table_figure
from vrchain.plots.scripts import run_script


def draw(results: Results) -> tuple[Figure, pd.DataFrame]:
    """The table as a picture and as numbers."""
    summary = results.summary()
    note = f"{TABLE_NOTE}\n{results.note()}"
    return table_figure(summary, results.qualities(), note), summary


if __name__ == "__main__":
    run_script(__file__, draw)
