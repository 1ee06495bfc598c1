"""What the time of an update goes into."""

import pandas as pd
from matplotlib.figure import Figure

from vrchain.experiments.ledger.latency import STAGES
from vrchain.experiments.reproduction.results import Results
from vrchain.plots.reproduction import update_stages_figure
from vrchain.plots.scripts import run_script


def draw(results: Results) -> tuple[Figure, pd.DataFrame]:
    """Median and quartiles of each stage."""
    updates = results.updates()
    stages = [*(f"{stage}_us" for stage in STAGES), "total_us"]
    quartiles = {n: t[stages].quantile([0.25, 0.5, 0.75]) for n, t in updates.items()}
    table = pd.concat(quartiles, names=["positions", "quantile"]).reset_index()
    return update_stages_figure(updates, results.note()), table


if __name__ == "__main__":
    run_script(__file__, draw)
