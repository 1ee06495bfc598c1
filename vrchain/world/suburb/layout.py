"""Where everything stands: buildings on lots, then vehicles, furniture, boundaries and plants."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from vrchain import seeding
from vrchain.errors import SpecError
from vrchain.world.buildings import plans
from vrchain.world.spec import SceneSpec
from vrchain.world.suburb import candidates
from vrchain.world.suburb.lots import Homestead, Lot, Premises, draw_lots, occupy, settle
from vrchain.world.suburb.site import Candidate, Placement, Site, repeats
from vrchain.world.suburb.streets import START_XY_M, TURNING_M, Streets, draw_streets

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
        draws = _draws(spec, attempt)
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


def _draws(spec: SceneSpec, attempt: int) -> Callable[[str], np.random.Generator]:
    """The generator of each part of one attempt, by name."""
    return lambda name: seeding.generator(spec.seed, "layout", attempt, name)


def _furnished(
    spec: SceneSpec,
    streets: Streets,
    lots: list[Lot],
    rng: Callable[[str], np.random.Generator],
) -> Layout:
    """Everything on its place along the streets; ``lots`` are enough for all buildings."""
    premises, free_lots = _occupy_all(spec, lots, rng("premises"))
    twins = repeats(spec.houses.count, spec.twins, seeding.generator(spec.seed, "house", "twins"))
    homes = _settle_all(spec, free_lots, twins, rng("houses"))
    site = Site(spec.extent_m)
    start = shapely.Point(START_XY_M)
    site.keep_free(start.buffer(1.5))
    for k, home in enumerate(homes):
        model = site.placements[twins[k]].model if k in twins else None
        site.add("house", Candidate(home.pose, home.plan.outline, home.plan, model))
    for place in premises:
        site.add(place.kind, Candidate(place.pose, place.plan.outline, place.plan), place.kind)

    drives = [h.driveway for h in homes] + [p.yard for p in premises if p.kind == "barn"]
    entries = shapely.union_all(
        [*(d.buffer(1.0) for d in drives), *(h.path for h in homes), *(p.yard for p in premises)]
    )
    junctions = shapely.union_all(
        [p.buffer(streets.half_m + 6.0) for p in streets.junctions]
        + [p.buffer(streets.half_m + TURNING_M + 1.0) for p in streets.heads]
    )
    keep_off = shapely.union_all(
        [
            *(d.buffer(1.8) for d in drives),
            *(h.path.buffer(0.8) for h in homes),
            junctions,
            start.buffer(4.5),
        ]
    )
    gardens_only = shapely.union_all([entries, streets.corridor.buffer(0.1)])
    off_road = shapely.union_all([entries, streets.road.buffer(0.1)])
    f, b = spec.furniture, spec.boundaries

    site.fill(
        "vehicle", "vehicles.count", spec.vehicles.count,
        candidates.parked(spec, streets, homes, keep_off, site.placements, rng("vehicles")),
    )  # fmt: skip
    site.fill(
        "mailbox",
        "furniture.mailboxes",
        f.mailboxes,
        candidates.mailboxes(homes, rng("mailboxes")),
        avoid=entries,
    )
    for kind, key, count, beyond_kerb_m, radius_m in (
        ("lamp", "lamps", f.lamps, 0.4, 0.16),
        ("hydrant", "hydrants", f.hydrants, 0.45, 0.25),
        ("pole", "poles", f.poles, streets.pavement_m + 0.5, 0.2),
    ):
        places = candidates.kerbside(streets, rng(key), count, beyond_kerb_m, radius_m)
        site.fill(kind, f"furniture.{key}", count, places, avoid=off_road)
    site.fill(
        "sign", "furniture.signs", f.signs, candidates.signs(streets, rng("signs")), avoid=off_road
    )
    runs = candidates.boundaries(lots, rng("boundaries"))
    for kind, key, count in (
        ("hedge", "hedges", b.hedges),
        ("wall", "walls", b.walls),
        ("fence", "fences", b.fences),
    ):
        site.fill(kind, f"boundaries.{key}", count, runs, avoid=gardens_only)
    site.fill(
        "bin", "furniture.bins", f.bins, candidates.bins(homes, rng("bins")), avoid=gardens_only
    )
    site.fill(
        "tree", "trees.count", spec.trees.count, candidates.trees(spec, lots, rng("trees")),
        avoid=gardens_only, fits=lambda tree: _crown_fits(tree, site.placements),
    )  # fmt: skip
    site.fill(
        "bush",
        "furniture.bushes",
        f.bushes,
        candidates.bushes(spec, lots, rng("bushes")),
        avoid=gardens_only,
    )
    return Layout(streets, tuple(lots), tuple(homes), tuple(premises), tuple(site.placements))


def _occupy_all(
    spec: SceneSpec, lots: list[Lot], rng: np.random.Generator
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
    for i, lot in enumerate(outer, start=1):
        big = plans.draw_barn(seeding.generator(spec.seed, "barn", i, "plan"))
        premises.append(occupy("barn", lot, big, _BARN_SETBACK_M, rng))
    for i, lot in enumerate(parade, start=1):
        shop = plans.draw_shop(seeding.generator(spec.seed, "shop", i, "plan"))
        premises.append(occupy("shop", lot, shop, _SHOP_SETBACK_M, rng))
    return premises, [lots[k] for k in free]


def _settle_all(
    spec: SceneSpec, lots: list[Lot], twins: dict[int, int], rng: np.random.Generator
) -> list[Homestead]:
    homes: list[Homestead] = []
    for i, k in enumerate(sorted(rng.permutation(len(lots))[: spec.houses.count])):
        plan = plans.draw_house(
            seeding.generator(spec.seed, "house", i + 1, "plan"), spec.houses.two_storey
        )
        if i in twins:
            plan = homes[twins[i]].plan
        homes.append(settle(lots[k], plan, float(rng.uniform(*spec.houses.setback_m)), rng))
    return homes


def _crown_fits(tree: Candidate, others: Sequence[Placement]) -> bool:
    """Crowns keep off houses, lamps and signs, and do not swallow one another."""
    radius = tree.plan.canopy_radius_m
    for other in others:
        gap = tree.pose.distance_to_m(other.pose.xy_m)
        if other.kind == "tree" and gap < 0.6 * (radius + other.plan.canopy_radius_m):
            return False
        if other.kind in ("lamp", "sign", "pole") and gap < 0.8 * radius:
            return False
        if other.kind in ("house", "shop", "barn") and gap < 16:
            building = Candidate(other.pose, other.plan.outline).ground
            if building.distance(shapely.Point(tree.pose.xy_m)) < radius + 0.4:
                return False
    return True
