"""Cross out landmarks of a team, and watch the chain to the goal being planned again."""

from collections.abc import Mapping
from itertools import chain as chained
from itertools import zip_longest

from vrchain.errors import MissionError
from vrchain.geometry import Pose
from vrchain.navigation.planning.planner import Planner
from vrchain.play.controls import Choice, Play, Shown
from vrchain.plots.teams import chain_map
from vrchain.simulation.sightings import Sightings, team_sightings
from vrchain.world.model import Scene

_CHANCE = 0.9  # to get on by any landmark, so that the shortest chain is the best


def team(scene: Scene, robots: Mapping[str, Pose] | None = None, goal: str | None = None) -> Play:
    """What a team sees, by truth, and the shortest chain from its first robot to the goal.

    robots and goal: the scene's own if none are given. MissionError without them.
    """
    robots, goal = dict(robots or scene.robots), goal or scene.goal
    if not robots or goal is None:
        raise MissionError(
            f"expected robots and a goal, and {scene.name!r} has none of its own: "
            "name them, as in team(scene, {'R1': vr.Pose(0, 0), ...}, 'house 1')"
        )
    if goal not in (known := {o.name for o in scene.objects if o.landmark}):
        raise MissionError(f"expected a goal of {', '.join(sorted(known))}, got {goal!r}")
    for pose in robots.values():
        scene.check_pose(pose)
    seen = team_sightings(scene, robots)
    labels = seen.labels()
    names = {f"{label}: {name.replace('_', ' ')}": name for name, label in labels.items()}

    def draw(without: tuple[str, ...]) -> Shown:
        left = _without(seen, {names[one] for one in without} - {goal})
        chain = shortest_chain(list(robots), left, goal)
        figure = chain_map(scene, robots, left, chain or [next(iter(robots))], labels)
        crossed = f"Without {', '.join(without)}: " if without else ""
        if chain is None:
            figure.axes[0].set_title(f"no chain leads to the {goal}")
            return Shown(f"{crossed}**no chain leads to the goal**.", figure)
        way = " - ".join(labels.get(one, one) for one in chain)
        return Shown(f"{crossed}**{way}**, {len(chain) // 2 - 1} landmarks on the way.", figure)

    return Play(draw, {"without": Choice("cross out", tuple(names), (), several=True)})


def shortest_chain(robots: list[str], seen: Sightings, goal: str) -> list[str] | None:
    """Robots and landmarks in turn from the first robot to the goal; None if none leads there."""
    legs = [(a, b, name) for (a, b), shared in seen.common.items() for name in shared]
    landmarks = sorted({name for _, _, name in legs})
    planner = Planner(
        len(robots),
        [robots.index(a) for a, _, _ in legs],
        [robots.index(b) for _, b, _ in legs],
        [landmarks.index(name) for _, _, name in legs],
        [_CHANCE] * len(legs),
    )
    shows = {k: _CHANCE for k, robot in enumerate(robots) if goal in seen.visible[robot]}
    found = planner.best(0, shows)
    if found is None:
        return None
    by = [landmarks[k] for k in found.landmarks]
    turns = zip_longest([robots[k] for k in found.robots], by, fillvalue=goal)
    return [*chained.from_iterable(turns)]


def _without(seen: Sightings, crossed: set[str]) -> Sightings:
    """As if nobody saw some landmarks."""
    visible = {r: tuple(n for n in own if n not in crossed) for r, own in seen.visible.items()}
    common = {p: tuple(n for n in own if n not in crossed) for p, own in seen.common.items()}
    return Sightings(visible, {pair: own for pair, own in common.items() if own})
