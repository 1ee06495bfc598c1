"""One mission: the map with the way driven, and the panoramas that its chain of landmarks joins."""

from vrchain.experiments.reproduction.results import Results
from vrchain.plots.missions import mission_figure, paths_table
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """The mission of the reproduction, and every robot's true path."""
    run = results.mission()
    return mission_figure(run), paths_table(run)


if __name__ == "__main__":
    run_script(__file__, draw)
