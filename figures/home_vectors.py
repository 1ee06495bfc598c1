"""Home vectors from all around one place: ours, and homing in scale space."""

from vrchain.experiments.homing import RIG, Grid, answers, draw_place
from vrchain.experiments.reproduction.results import Results, suburb
from vrchain.plots.homing import home_vectors_figure
from vrchain.plots.scripts import Drawn, run_script
from vrchain.seeding import generator
from vrchain.world.render import Renderer

ROWS = ("epipolar", "scale")


def draw(results: Results) -> Drawn:
    """One place of the suburb, its starts closer together for a larger profile."""
    seed = results.profile.seed
    spacing_m = {"smoke": 2.5, "paper": 0.5}.get(results.profile.name, 1.0)
    grid = Grid(spacing_m=spacing_m, near_reach_m=0.0)
    home = draw_place(suburb(), generator(seed, "home"))
    draws = generator(seed, "homing")
    found = answers(Renderer(suburb()), home, draws, ROWS, grid=grid, rig=RIG)
    around = found[(found.x_m != 0) | (found.y_m != 0)]
    drawn = home_vectors_figure(suburb(), home, around, ROWS)
    return drawn, around.drop(columns="home")  # that takes closer points around home to tell


if __name__ == "__main__":
    run_script(__file__, draw)
