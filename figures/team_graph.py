"""The team as a graph, as in the paper's figure 1: robots, and the landmarks that join them."""

from vrchain.experiments.reproduction.results import Results, barn
from vrchain.plots.scripts import Drawn, run_script
from vrchain.plots.teams import chain_of, team_graph
from vrchain.simulation.sightings import sightings_table, team_sightings


def draw(results: Results) -> Drawn:
    """The team of ``scenes/barn.yaml``, by ground truth."""
    scene, robots = barn(), dict(barn().robots)
    seen = team_sightings(scene, robots)
    chain = chain_of(list(robots), seen, scene.goal)
    return team_graph(list(robots), seen, chain), sightings_table(scene, robots, seen)


if __name__ == "__main__":
    run_script(__file__, draw)
