"""Where everything stands: houses on lots, then vehicles, furniture, boundaries and plants."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from vrchain import seeding
from vrchain.errors import SpecError
from vrchain.scene import candidates, house_plans
from vrchain.scene.lots import Homestead, Lot, draw_lots, settle
from vrchain.scene.site import Candidate, Placement, Site
from vrchain.scene.spec import SceneSpec
from vrchain.scene.streets import START_XY_M, Streets, draw_streets


@dataclass(frozen=True, eq=False)
class Layout:
    """The plan of a suburb."""

    streets: Streets
    lots: tuple[Lot, ...]
    homesteads: tuple[Homestead, ...]
    placements: tuple[Placement, ...]


def draw_layout(spec: SceneSpec) -> Layout:
    """Place everything the spec asks for. Raises SpecError when something has no room."""

    def rng(name: str) -> np.random.Generator:
        return seeding.generator(spec.seed, "layout", name)

    streets = draw_streets(spec, rng("streets"))
    lots = draw_lots(streets, spec.extent_m, rng("lots"))
    homes = _settle_all(spec, lots, rng("houses"))
    site = Site(spec.extent_m)
    start = shapely.Point(START_XY_M)
    site.keep_free(start.buffer(1.5))
    for home in homes:
        site.add("house", Candidate(home.pose, home.plan.outline, home.plan))

    entries = shapely.union_all(
        [ground for h in homes for ground in (h.driveway.buffer(1.0), h.path)]
    )
    junctions = shapely.union_all([p.buffer(streets.half_m + 6.0) for p in streets.junctions])
    keep_off = shapely.union_all([entries.buffer(0.8), junctions, start.buffer(4.5)])
    gardens_only = shapely.union_all([entries, streets.corridor.buffer(0.1)])
    f, b = spec.furniture, spec.boundaries

    site.fill(
        "vehicle", "vehicles.count", spec.vehicles.count,
        candidates.parked(spec, streets, homes, keep_off, rng("vehicles")),
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
        site.fill(kind, f"furniture.{key}", count, places, avoid=entries)
    site.fill(
        "sign", "furniture.signs", f.signs, candidates.signs(streets, rng("signs")), avoid=entries
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
    return Layout(streets, tuple(lots), tuple(homes), tuple(site.placements))


def _settle_all(spec: SceneSpec, lots: list[Lot], rng: np.random.Generator) -> list[Homestead]:
    count = spec.houses.count
    if count > len(lots):
        raise SpecError(
            f"houses.count: {count} do not fit along these streets, allowed here 0..{len(lots)}"
        )
    homes = []
    for i, k in enumerate(sorted(rng.permutation(len(lots))[:count]), start=1):
        plan = house_plans.draw_plan(
            seeding.generator(spec.seed, "house", i, "plan"), spec.houses.two_storey
        )
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
        if other.kind == "house" and gap < 14:
            house = Candidate(other.pose, other.plan.outline).ground
            if house.distance(shapely.Point(tree.pose.xy_m)) < radius + 0.4:
                return False
    return True
