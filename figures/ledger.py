"""The chain: blocks, the hashes that join them, and each robot's newest transaction."""

from itertools import islice

from vrchain.experiments.reproduction.results import Results
from vrchain.ledger import Ledger
from vrchain.plots.ledger import ledger_figure, ledger_table
from vrchain.plots.scripts import Drawn, run_script

SHOWN = 6


def draw(results: Results) -> Drawn:
    """The first blocks of the survey's ledger."""
    with Ledger.open(results.path("survey", "ledger")) as ledger:
        entries = list(islice(ledger.entries(), SHOWN))
        title = (
            f"The first {len(entries)} of {ledger.head.height + 1} blocks of the survey's ledger"
        )
    return ledger_figure(entries, title), ledger_table(entries)


if __name__ == "__main__":
    run_script(__file__, draw)
