"""Bytes and messages on the wire over robots: each to each, and by way of a ledger."""

from vrchain.experiments.ledger.transmission import transmission
from vrchain.experiments.reproduction.results import Results
from vrchain.plots.ledger import transmission_figure
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """Random bytes, as many as the survey's panoramas have on average."""
    payload_bytes = round(results.table("retrieval", "throughput").payload_bytes[0])
    table = transmission(payload_bytes=payload_bytes)
    note = (
        f"payloads simulated: {payload_bytes} random bytes; messages as they travel, counted; "
        "hollow: no such way is in the ledger yet"
    )
    return transmission_figure(table, payload_bytes, note), table


if __name__ == "__main__":
    run_script(__file__, draw)
