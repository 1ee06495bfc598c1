"""What the time of an update goes into."""

from vrchain.experiments.ledger.latency import stage_quartiles
from vrchain.experiments.reproduction.results import Results
from vrchain.plots.reproduction import update_stages_figure
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """Median and quartiles of each stage."""
    updates = results.updates()
    return update_stages_figure(updates, results.note()), stage_quartiles(updates)


if __name__ == "__main__":
    run_script(__file__, draw)
