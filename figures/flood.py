"""One robot floods the others' gate: what they notice, and what becomes of the flood."""

from dataclasses import replace

from vrchain.experiments.ledger.flood import FloodConfig, flood, outcomes, summarise
from vrchain.experiments.reproduction.results import Results
from vrchain.plots.ledger import flood_figure
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """Measured when it is drawn, for longer in a larger profile."""
    seed, name = results.profile.seed, results.profile.name
    config = FloodConfig(rounds={"smoke": 1, "paper": 10}.get(name, 2), seed=seed)
    if name == "smoke":
        config = replace(config, robots=2, phase_s=0.5)
    measured = flood(config)
    table, floods = summarise(measured, seed=seed), outcomes(measured)
    return flood_figure(table, floods, config), table.merge(floods, on="name")


if __name__ == "__main__":
    run_script(__file__, draw)
