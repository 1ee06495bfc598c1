"""The paper's example from above: the team, what each robot sees, and the chain to the barn."""

from vrchain.experiments.reproduction.results import Results, barn
from vrchain.plots.scripts import Drawn, run_script
from vrchain.plots.teams import chain_map, chain_of
from vrchain.simulation.sightings import sightings_table, team_sightings


def draw(results: Results) -> Drawn:
    """The map of ``scenes/barn.yaml``, by ground truth."""
    scene, robots = barn(), dict(barn().robots)
    seen = team_sightings(scene, robots)
    chain = chain_of(list(robots), seen, scene.goal)
    return chain_map(scene, robots, seen, chain), sightings_table(scene, robots, seen)


if __name__ == "__main__":
    run_script(__file__, draw)
