"""Chains of landmarks when segments are lost: the planner beside two known ones."""

import pandas as pd

from vrchain.experiments.planning.lost_segments import TASKS_A_WORLD, blocked_drives, shares
from vrchain.experiments.planning.published_drives import by_team, one_drive
from vrchain.experiments.reproduction.results import Results
from vrchain.plots.planning import TEAMS_SHOWN, planning_figure
from vrchain.plots.scripts import Drawn, run_script


def draw(results: Results) -> Drawn:
    """Drives on random graphs, more of them for a larger profile."""
    seed = results.profile.seed
    worlds = {"smoke": 2, "paper": 40}.get(results.profile.name, 10)
    again = shares(blocked_drives(worlds, TASKS_A_WORLD, seed=seed), seed=seed)
    once = one_drive(worlds, TASKS_A_WORLD, seed=seed, teams=TEAMS_SHOWN)
    teams = by_team(once, seed=seed)
    return planning_figure(again, teams), pd.concat([again, teams])


if __name__ == "__main__":
    run_script(__file__, draw)
