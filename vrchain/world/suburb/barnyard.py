"""The paper's example: R1 must bring its load to a barn that only R3 sees.

Two high walls leave an S-shaped way between them. R1 stands south of both, R2 between them, R3
north of both and before the barn. R1 and R2 both see the shed at the western end of the first wall,
R2 and R3 the water tower at the eastern end of the second. Everything else that stands is hidden by
a wall from all robots but one. Two robots see each wall, but never the same side of it.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import shapely
from numpy.random import Generator

from vrchain import seeding
from vrchain.geometry import Pose
from vrchain.world import seasons, textures
from vrchain.world.backdrop import outdoors
from vrchain.world.buildings import barn, plans
from vrchain.world.model import Scene, SceneObject, Surface, place
from vrchain.world.shapes import Image
from vrchain.world.spec import LightSpec, SceneSpec
from vrchain.world.suburb import ground
from vrchain.world.things import boundaries, farm, furniture, plants, vehicles

EXTENT_M = (90.0, 90.0)
GOAL = "barn"
START_SPREAD_M = 2.0  # how far R1 may start from its place in the plan
_ROBOTS_XY_M = {"R1": (-3.0, -28.0), "R2": (0.0, -12.0), "R3": (4.0, 8.0)}
_WALL_M, _RUN_M = 3.4, 8.0
_TREE_M = (3.8, 4.8)  # low enough to stay behind the walls
_LANE_M = 3.2
_LANE_XY_M = (
    (160, -36), (60, -34), (20, -33), (4, -30), (-7, -26.5), (-12.6, -21.5), (-10.5, -15.5),
    (-3, -12.3), (5, -10.5), (10.5, -8), (13, -3.5), (11.5, 2.5), (6.5, 7), (4, 13), (4, 26),
)  # fmt: skip
_FIELDS_XY_M = {
    "wheat": ((-30, 12), (-62, 12), (-66, 70), (-22, 70)),
    "ploughed": ((26, -44), (-30, -44), (-30, -90), (26, -90)),
    "clover": ((32, -2), (90, -2), (90, 60), (32, 60)),
}

_Build = Callable[[Generator], tuple[Surface, ...]]
_Thing = tuple[str, str, tuple[float, ...], _Build]  # name, kind, (x, y, yaw), and how it is built


def build(spec: SceneSpec) -> Scene:
    """The example of a spec's seed: headings, R1's start, the sun and all designs are drawn."""
    lit = _sun(spec.light, seeding.generator(spec.seed, "sun"))
    spec = replace(spec, light=lit, extent_m=EXTENT_M)
    standing = (
        place(
            name, kind, name, made(seeding.generator(spec.seed, name)), Pose(*pose), landmark=True
        )
        for name, kind, pose, made in _things(spec.seed, spec.season)
    )
    floor = _floor(spec.season, seeding.generator(spec.seed, "ground"))
    return replace(outdoors(spec, standing, floor), robots=_robots(spec.seed), goal=GOAL)


def _robots(seed: int) -> tuple[tuple[str, Pose], ...]:
    """Random headings, and R1 somewhere within ``START_SPREAD_M``."""
    robots = []
    for name, (x_m, y_m) in _ROBOTS_XY_M.items():
        draws = seeding.generator(seed, "robot", name)
        yaw = draws.uniform(-np.pi, np.pi)
        if name == "R1":
            reach, turn = START_SPREAD_M * np.sqrt(draws.uniform()), draws.uniform(0, 2 * np.pi)
            x_m, y_m = x_m + reach * np.cos(turn), y_m + reach * np.sin(turn)
        robots.append((name, Pose(float(x_m), float(y_m), float(yaw))))
    return tuple(robots)


def _sun(spec: LightSpec, rng: Generator) -> LightSpec:
    """The spec's sun, some way on its path."""
    return replace(
        spec,
        sun_azimuth_deg=float((spec.sun_azimuth_deg + rng.uniform(-25, 25)) % 360),
        sun_elevation_deg=float(np.clip(spec.sun_elevation_deg + rng.uniform(-4, 4), 10, 85)),
    )


def _things(seed: int, season: str) -> Iterator[_Thing]:
    """What stands, from the south to the north but for the two walls."""

    def draws(name: str) -> Generator:
        return seeding.generator(seed, name, "plan")

    def vehicle(name: str, *pose: float) -> _Thing:
        """The first vehicle drawn that goes by this name."""
        found = iter(partial(vehicles.draw_plan, draws(name)), None)
        plan = next(plan for plan in found if plan.name == name)
        return name, "vehicle", pose, partial(vehicles.build, plan)

    def tree(name: str, *pose: float) -> _Thing:
        plan = plants.draw_tree(draws(name), _TREE_M)
        return name, "tree", pose, partial(plants.build_tree, plan, season=season)

    fence = partial(boundaries.build_fence, _RUN_M, True)
    bush = partial(plants.build_bush, 1.9, season=season)
    yield GOAL, "barn", (4.0, 31.0), partial(barn.build, plans.draw_barn(draws(GOAL)))
    yield "shed", "shed", (-18.0, -19.5, np.pi / 2), farm.shed
    yield "water_tower", "water tower", (18.0, -4.0, -np.pi / 2), farm.water_tower
    yield from _screens(seed)
    # Around R1.
    yield vehicle("pickup", 6.5, -26.0, 2.9)
    yield tree("tree_01", 14.0, -27.0)
    yield "bales_01", "bales", (-1.5, -36.5, 0.5), farm.bales
    for k in range(3):
        yield f"fence_{k + 1:02d}", "fence", (4.5 + 8.2 * k, -38.5), fence
    # Around R2.
    yield "bales_02", "bales", (-6.5, -7.5, 0.3), farm.bales
    yield "trough", "trough", (-2.0, -17.3, 0.05), farm.trough
    yield "bush", "bush", (6.0, -16.3), bush
    yield "mailbox", "mailbox", (2.6, -8.6, -0.2), furniture.mailbox
    # Around R3, before the barn.
    yield tree("tree_02", -11.0, 14.0)
    yield "bales_03", "bales", (-5.0, 7.0, -0.4), farm.bales
    yield vehicle("car", 11.5, 13.5, -1.9)
    for k, x_m in enumerate((-12.0, -3.8, 12.0, 20.2), start=4):
        yield f"fence_{k:02d}", "fence", (x_m, 20.5), fence


def _screens(seed: int) -> Iterator[_Thing]:
    """The two walls, each of three runs."""
    for first, material, first_x_m, y_m in ((1, "stone", -6.0, -19.5), (4, "brick", -10.0, -4.5)):
        draws = seeding.generator(seed, "wall", material)
        for k, plan in enumerate(farm.wall_plans(3, _RUN_M, _WALL_M, material, draws)):
            pose = (first_x_m + k * _RUN_M, y_m)
            yield f"wall_{first + k:02d}", "wall", pose, partial(farm.high_wall, plan)


def _floor(season: str, rng: Generator) -> Iterator[SceneObject]:
    """A lane through grass, a yard before the barn, and fields around."""
    everything = ground.around(EXTENT_M)
    lane = _smooth(shapely.LineString(_LANE_XY_M)).buffer(_LANE_M / 2, cap_style="flat")
    yard = shapely.box(-7.0, 21.5, 15.0, 26.0).buffer(1.5)
    fields = {name: shapely.Polygon(xy) for name, xy in _FIELDS_XY_M.items()}
    lane = lane.difference(yard)

    def earth(hue: float, saturation: float, value: float, contrast: float) -> Image:
        colour = textures.hsv(hue + rng.uniform(-4, 4), saturation, value)
        colour = seasons.grass(colour, season) if hue > 60 else colour
        return textures.ground(rng, colour, contrast, 5)

    rest = everything.difference(shapely.union_all([lane, yard, *fields.values()]))
    pieces: list[ground.Piece] = [
        ("lane", "lane", lane, earth(32, 0.3, 0.62, 0.1), 5.0),
        ("yard", "yard", yard, earth(38, 0.16, 0.66, 0.12), 5.0),
        ("wheat", "field", fields["wheat"], earth(46, 0.5, 0.74, 0.12), 6.0),
        ("ploughed", "field", fields["ploughed"], earth(24, 0.38, 0.42, 0.14), 6.0),
        ("clover", "field", fields["clover"], earth(96, 0.5, 0.44, 0.12), 6.0),
        ("grass", "grass", rest, earth(82, 0.48, 0.54, 0.12), 9.0),
    ]
    return ground.lay(pieces, everything)


def _smooth(line: shapely.LineString) -> shapely.LineString:
    """The line with its corners cut three times (Chaikin)."""
    xy = shapely.get_coordinates(line)
    for _ in range(3):
        near, far = 0.75 * xy[:-1] + 0.25 * xy[1:], 0.25 * xy[:-1] + 0.75 * xy[1:]
        inner = np.stack([near, far], axis=1).reshape(-1, 2)
        xy = np.concatenate([xy[:1], inner, xy[-1:]])
    return shapely.LineString(xy)
