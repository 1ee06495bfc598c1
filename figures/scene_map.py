"""The suburb from above."""

import pandas as pd
from matplotlib.figure import Figure

from vrchain.experiments.reproduction.results import Results, suburb
from vrchain.plots.maps import scene_map
from vrchain.plots.scripts import run_script


def draw(results: Results) -> tuple[Figure, pd.DataFrame]:
    """The whole map, and the model database."""
    return scene_map(suburb()), suburb().table


if __name__ == "__main__":
    run_script(__file__, draw)
