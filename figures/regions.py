"""Parallel ledgers of the suburb's 2 x 2 regions: bytes saved, and landmarks missed."""

from vrchain.experiments.ledger.regions import FIELDS, regional
from vrchain.experiments.reproduction.results import Results, suburb
from vrchain.plots.ledger import regions_figure
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """Robots with a panorama each, at places drawn by the profile's seed."""
    table = regional(suburb(), seed=results.profile.seed)
    columns, rows = FIELDS
    note = (
        f"{table.robots[0]} robots, a panorama of 200 KB each, in the suburb of 130 x 180 m, "
        f"{columns} x {rows} regions; landmarks in common by ground truth; bytes counted: no such "
        "way is in the ledger yet"
    )
    return regions_figure(table, note), table


if __name__ == "__main__":
    run_script(__file__, draw)
