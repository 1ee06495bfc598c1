"""Update time of R1 and R2 over 40 and 200 positions."""

import pandas as pd

from vrchain.experiments.reproduction.results import Results
from vrchain.plots.reproduction import update_time_figure
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """Each update as a point, the two smaller numbers of positions."""
    updates = dict(list(results.updates().items())[:2])
    table = pd.concat(updates, names=["positions"]).reset_index("positions")
    return update_time_figure(updates, results.note()), table


if __name__ == "__main__":
    run_script(__file__, draw)
