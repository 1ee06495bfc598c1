"""Update time of R1 and R2 over 40 and 200 positions in a folder, and beside it over servers."""

import pandas as pd

from vrchain.experiments.reproduction.results import Results
from vrchain.plots.reproduction import update_time_figure
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """Each update as a point, the two smaller numbers of positions; over servers the smallest."""
    updates = dict(list(results.updates().items())[:2])
    over = results.update_servers()
    tables = [table.assign(positions=n, over="folder") for n, table in updates.items()]
    if over is not None:
        tables.append(over.assign(positions=len(over), over="servers"))
    return update_time_figure(updates, results.note(), over), pd.concat(tables)


if __name__ == "__main__":
    run_script(__file__, draw)
