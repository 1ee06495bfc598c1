"""The ledger's size over positions and robots, beside the paper's inline layout."""

from vrchain.experiments.ledger.size import ledger_sizes
from vrchain.experiments.reproduction.results import Results
from vrchain.plots.ledger import ledger_size_figure
from vrchain.plots.scripts import Drawn, run_script

ROBOTS = (2, 10, 100)


def draw(results: Results) -> Drawn:
    """Real ledgers, of panoramas as large as the survey's are on average."""
    payload_bytes = round(results.table("retrieval", "throughput").payload_bytes[0])
    sizes = ledger_sizes(results.profile.positions, ROBOTS, payload_bytes)
    return ledger_size_figure(sizes, results.note()), sizes


if __name__ == "__main__":
    run_script(__file__, draw)
