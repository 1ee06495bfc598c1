"""The suburb from above."""

from vrchain.experiments.reproduction.results import Results, suburb
from vrchain.plots.maps import scene_map
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """The whole map, and the model database."""
    return scene_map(suburb()), suburb().table


if __name__ == "__main__":
    run_script(__file__, draw)
