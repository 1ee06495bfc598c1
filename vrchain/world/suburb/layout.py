"""Where everything stands: buildings on lots, then vehicles, furniture, boundaries and plants."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray

from vrchain import seeding
from vrchain.errors import SpecError
from vrchain.world.buildings import plans
from vrchain.world.spec import SceneSpec
from vrchain.world.suburb import candidates
from vrchain.world.suburb.lots import Homestead, Lot, Premises, draw_lots, occupy, settle
from vrchain.world.suburb.site import Candidate, Placement, Site, repeats
from vrchain.world.suburb.streets import START_XY_M, TURNING_M, Streets, draw_streets
from vrchain.world.things.plants import TreePlan

_PATTERNS = 40  # of streets are drawn until one has lots enough
_LAYOUTS = 2  # are tried before a spec is said not to fit
_SHOP_SETBACK_M = (2.6, 4.6)  # from the pavement to the front wall
_BARN_SETBACK_M = (4.0, 8.0)


@dataclass(frozen=True, eq=False)
class Layout:
    """The plan of a suburb."""

    streets: Streets
    lots: tuple[Lot, ...]
    homesteads: tuple[Homestead, ...]
    premises: tuple[Premises, ...]
    placements: tuple[Placement, ...]


def draw_layout(spec: SceneSpec) -> Layout:
    """Place everything the spec asks for. Raises SpecError when something has no room.

    Patterns of streets differ in the room that they leave: the first that has enough is taken.
    """
    wanted = {key: getattr(spec, key).count for key in ("houses", "shops", "barns")}
    most, refusals = 0, []
    for attempt in range(_PATTERNS):
        draws = partial(seeding.generator, spec.seed, "layout", attempt)
        streets = draw_streets(spec, draws("streets"))
        lots = draw_lots(streets, spec.extent_m, draws("lots"))
        most = max(most, len(lots))
        if len(lots) < sum(wanted.values()):
            continue
        try:
            return _furnished(spec, streets, lots, draws)
        except SpecError as refusal:
            refusals.append(refusal)
            if len(refusals) == _LAYOUTS:
                raise
    if refusals:
        raise refusals[-1]
    key = max(wanted, key=lambda k: wanted[k])
    left = max(0, most - sum(wanted.values()) + wanted[key])
    raise SpecError(
        f"{key}.count: {wanted[key]} do not fit along these streets, allowed here 0..{left}"
    )


def _furnished(
    spec: SceneSpec, streets: Streets, lots: list[Lot], rng: Callable[[str], Generator]
) -> Layout:
    """Everything on its place along the streets; ``lots`` are enough for all buildings."""
    premises, free_lots = _occupy_all(spec, lots, rng("premises"))
    twins = repeats(spec.houses.count, spec.twins, seeding.generator(spec.seed, "house", "twins"))
    homes = _settle_all(spec, free_lots, twins, rng("houses"))
    site, start = Site(spec.extent_m), shapely.Point(START_XY_M)
    site.keep_free(start.buffer(1.5))
    for k, home in enumerate(homes):
        model = site.placements[twins[k]].model if k in twins else None
        site.add("house", Candidate(home.pose, home.plan.outline, home.plan, model))
    for place in premises:
        site.add(place.kind, Candidate(place.pose, place.plan.outline, place.plan))

    drives = [h.driveway for h in homes] + [p.yard for p in premises if p.kind == "barn"]
    paths, yards = [h.path for h in homes], [p.yard for p in premises]
    entries = shapely.union_all([*shapely.buffer(drives, 1.0), *paths, *yards])
    junctions = shapely.union_all(
        [p.buffer(streets.half_m + 6.0) for p in streets.junctions]
        + [p.buffer(streets.half_m + TURNING_M + 1.0) for p in streets.heads]
    )
    wide = [*shapely.buffer(drives, 1.8), *shapely.buffer(paths, 0.8)]
    keep_off = shapely.union_all([*wide, junctions, start.buffer(4.5)])
    gardens_only = shapely.union_all([entries, streets.corridor.buffer(0.1)])
    off_road = shapely.union_all([entries, streets.road.buffer(0.1)])

    def at_kerb(key: str, beyond_kerb_m: float, radius_m: float) -> candidates.Groups:
        count = getattr(spec.furniture, key)
        return candidates.kerbside(streets, rng(key), count, beyond_kerb_m, radius_m)

    parked = candidates.parked(spec, streets, homes, keep_off, site.placements, rng("vehicles"))
    runs = candidates.boundaries(lots, rng("boundaries"))
    pole_m = streets.pavement_m + 0.5
    for kind, key, groups, avoid in (
        ("vehicle", "vehicles.count", parked, shapely.Polygon()),
        ("mailbox", "furniture.mailboxes", candidates.mailboxes(homes, rng("mailboxes")), entries),
        ("lamp", "furniture.lamps", at_kerb("lamps", 0.4, 0.16), off_road),
        ("hydrant", "furniture.hydrants", at_kerb("hydrants", 0.45, 0.25), off_road),
        ("pole", "furniture.poles", at_kerb("poles", pole_m, 0.2), off_road),
        ("sign", "furniture.signs", candidates.signs(streets, rng("signs")), off_road),
        ("hedge", "boundaries.hedges", runs, gardens_only),
        ("wall", "boundaries.walls", runs, gardens_only),
        ("fence", "boundaries.fences", runs, gardens_only),
        ("bin", "furniture.bins", candidates.bins(homes, rng("bins")), gardens_only),
        ("tree", "trees.count", candidates.trees(spec, lots, rng("trees")), gardens_only),
        ("bush", "furniture.bushes", candidates.bushes(spec, lots, rng("bushes")), gardens_only),
    ):
        count = attrgetter(key)(spec)
        site.fill(kind, key, count, groups, avoid, partial(_fits, site.placements))
    return Layout(streets, tuple(lots), tuple(homes), tuple(premises), tuple(site.placements))


def _occupy_all(
    spec: SceneSpec, lots: list[Lot], rng: Generator
) -> tuple[list[Premises], list[Lot]]:
    """Barns on lots at the map's rim, shops side by side; and the lots left over."""
    free = list(range(len(lots)))

    def take(count: int, cost: NDArray[np.float64]) -> list[Lot]:
        """The free lots of least cost."""
        taken = sorted(free, key=lambda k: float(cost[k]))[:count]
        for k in taken:
            free.remove(k)
        return [lots[k] for k in taken]

    middles = np.array([lot.middle_xy_m for lot in lots]).reshape(-1, 2)
    to_rim = (np.array(spec.extent_m) / 2 - np.abs(middles)).min(axis=1, initial=np.inf)
    outer = take(spec.barns.count, to_rim + 15.0 * rng.random(len(lots)))
    heart = middles[int(rng.integers(len(lots)))] if lots else np.zeros(2)
    parade = take(spec.shops.count, np.hypot(*(middles - heart).T))
    premises = []
    for kind, chosen, draw, setback_m in (
        ("barn", outer, plans.draw_barn, _BARN_SETBACK_M),
        ("shop", parade, plans.draw_shop, _SHOP_SETBACK_M),
    ):
        for i, lot in enumerate(chosen, start=1):
            plan = draw(seeding.generator(spec.seed, kind, i, "plan"))
            premises.append(occupy(lot, plan, setback_m, rng))
    return premises, [lots[k] for k in free]


def _settle_all(
    spec: SceneSpec, lots: list[Lot], twins: dict[int, int], rng: Generator
) -> list[Homestead]:
    homes: list[Homestead] = []
    for i, k in enumerate(sorted(rng.permutation(len(lots))[: spec.houses.count])):
        draws = seeding.generator(spec.seed, "house", i + 1, "plan")
        plan = plans.draw_house(draws, spec.houses.two_storey)
        if i in twins:
            plan = homes[twins[i]].plan
        homes.append(settle(lots[k], plan, float(rng.uniform(*spec.houses.setback_m)), rng))
    return homes


def _fits(others: Sequence[Placement], thing: Candidate) -> bool:
    """Crowns keep off houses, lamps and signs, and do not swallow one another."""
    if not isinstance(thing.plan, TreePlan):
        return True
    radius = thing.plan.canopy_radius_m
    for other in others:
        gap = thing.pose.distance_to_m(other.pose.xy_m)
        if other.kind == "tree" and gap < 0.6 * (radius + other.plan.canopy_radius_m):
            return False
        if other.kind in ("lamp", "sign", "pole") and gap < 0.8 * radius:
            return False
        if other.kind in ("house", "shop", "barn") and gap < 16:
            building = Candidate(other.pose, other.plan.outline).ground
            if building.distance(shapely.Point(thing.pose.xy_m)) < radius + 0.4:
                return False
    return True
