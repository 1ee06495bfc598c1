"""A mission replayed by a slider: the map, the look, the decision, and what was believed then."""

from textwrap import shorten

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vrchain.navigation.planning.route import Route
from vrchain.play.controls import WIDTH_IN, Play, PlayError, Shown, Slider
from vrchain.plots.missions import Row, chain_rows, draw_row, draw_stage
from vrchain.plots.style import BLUE, RED, robot_colour
from vrchain.simulation.mission import MissionRun

_LINES = 4  # of the log before the decision
_WIDTH = 80  # characters of a reason


def replay(run: MissionRun) -> Play:
    """A mission at each of its decisions. PlayError if nothing was decided."""
    decisions = run.result.decisions
    if not decisions:
        raise PlayError("expected a mission in which something was decided, got one without")

    def draw(decision: int) -> Shown:
        number = int(decision)
        now, past = decisions[number], decisions[: number + 1]
        n_plans = sum(d.what == "route" for d in past)
        plan = run.result.plans[n_plans - 1] if n_plans else None
        look = next((d.look for d in reversed(past) if d.look is not None), None)
        figure = Figure(figsize=(WIDTH_IN, 10.0), layout="constrained")
        grid = figure.add_gridspec(3, 2, height_ratios=[1, 1, 2.6], width_ratios=[1.5, 1])
        rows = chain_rows(run, *plan) if plan else []
        above, below = figure.add_subplot(grid[0, :]), figure.add_subplot(grid[1, :])
        _look(above, run, look, rows)
        if rows:
            draw_row(below, rows[-1]._replace(title=f"by the ledger, {rows[-1].title}"))
        else:
            below.set_axis_off()
        above.set_xlabel("")
        _way(figure.add_subplot(grid[2, 0]), run, now.time_s)
        _belief(figure.add_subplot(grid[2, 1]), plan[1] if plan else None)
        figure.suptitle(f"{now.what}: {shorten(now.why, _WIDTH)}", fontsize=11)
        says = (
            f"After {now.time_s - decisions[0].time_s:.0f} s, decision {number + 1} of "
            f"{len(decisions)}: **{now.what}** - {now.why}."
        )
        log = pd.DataFrame(
            [(f"{d.time_s:.1f}", d.what, d.why) for d in past[-_LINES:]],
            columns=["time (s)", "decision", "why"],
        )
        return Shown(says, figure, log)

    return Play(draw, {"decision": Slider("decision", 0, len(decisions) - 1, 1, 0)})


def _look(axes: Axes, run: MissionRun, look: int | None, rows: list[Row]) -> None:
    """What the robot saw, with what its plan marks in it, if that begins with this look."""
    axes.set_axis_off()
    if look is not None:
        seen = run.result.looks[look]
        marks = rows[0].marks if rows and rows[0].panorama is seen else ()
        draw_row(axes, Row(f"look {look} of {run.robot}, by which it decided", seen, marks))
        axes.set_axis_on()


def _way(axes: Axes, run: MissionRun, time_s: float) -> None:
    """From above, all robots, and the way driven so far."""
    draw_stage(axes, run)
    n = max(1, int((run.times_s <= time_s).sum()))
    for number, (name, path_xy_m) in enumerate(run.paths_xy_m.items()):
        colour = robot_colour(number)
        axes.plot(*path_xy_m[:n].T, color=colour, lw=2, zorder=5)
        axes.plot(*path_xy_m[n - 1], "o", color=colour, mec="white", ms=9, zorder=6)
        axes.annotate(name, tuple(path_xy_m[n - 1]), xytext=(8, 6), textcoords="offset points",
                      color=colour, fontweight="bold", zorder=7)  # fmt: skip
    axes.set_title("from above: no robot has this map", fontsize=10)


def _belief(axes: Axes, route: Route | None) -> None:
    """What the plan in force takes for true, and how surely."""
    axes.set_title("what it believes", fontsize=10)
    if route is None:
        axes.text(0.5, 0.5, "no plan yet", ha="center", va="center")
        axes.set_axis_off()
        return
    beliefs = []
    for k, leg in enumerate(route.legs, 1):
        what = "by odometry" if leg.by_odometry else f"L{k}{k + 1}: one landmark"
        beliefs.append((f"{what}\n{leg.seen_by} and {leg.next_by} see", leg.chance))
    beliefs.append((f"{route.seen_by} sees the goal", route.sighting.chance))
    beliefs.append(("it gets past all of them", route.score))
    beliefs.append(("this leads to the goal at all", route.trust))
    names, chances = zip(*beliefs, strict=True)
    axes.barh(range(len(names)), chances, height=0.4, color=[BLUE] * (len(names) - 2) + [RED] * 2)
    for k, (name, chance) in enumerate(beliefs):
        axes.text(0.02, k - 0.24, f"{name}: {chance:.2f}", va="bottom", fontsize=9)
    axes.set(xlim=(0, 1), yticks=[], xlabel="chance that it is so", ylim=(len(names), -1.0))
