"""Parked cars, vans and pickups: side outlines made solid, with wheels and painted details.

Model frame: the front towards +x, the middle at the origin, wheels on z = 0.
"""

import numpy as np
from numpy.typing import NDArray

from vrchain.world import textures
from vrchain.world.model import Surface
from vrchain.world.shapes import Model, Part, box, join, polygon, tube
from vrchain.world.things import vehicle_art
from vrchain.world.things.vehicle_plans import BOTTOM_M, VehiclePlan


def build(plan: VehiclePlan, rng: np.random.Generator) -> tuple[Surface, ...]:
    """A vehicle of a plan."""
    model = Model()
    rgb = vehicle_art.paint_rgb(rng)
    length, half = plan.length_m, plan.width_m / 2
    side = vehicle_art.side(plan, rng, rgb)
    mirrored = side[:, ::-1].copy()
    if rng.random() < 0.4 or plan.style == "van":  # a firm's name, on both sides alike
        vehicle_art.lettering(plan, side, rgb, front_right=True)
        vehicle_art.lettering(plan, mirrored, rgb, front_right=False)
    patches = {1: model.patch(mirrored), -1: model.patch(side)}
    top = model.patch(textures.plain(rng, rgb, (40, 40), 0.02))
    glass = model.patch(vehicle_art.screen(rng))

    outline, inset = _outline(plan)
    n = len(outline)
    y = half - inset
    for i in range(n):
        j = (i + 1) % n
        (xa, za), (xb, zb) = outline[i], outline[j]
        quad = [(xa, -y[i], za), (xa, y[i], za), (xb, y[j], zb), (xb, -y[j], zb)]
        kind = _STRIPS[i]
        if i > 4:  # behind the roof's front the upper edge comes first: keep pictures upright
            quad = quad[2:] + quad[:2]
        if kind in ("front", "rear"):
            patch = model.patch(vehicle_art.end(plan, rng, rgb, front=kind == "front"))
        else:
            patch = glass if kind == "glass" else top
        model.add(polygon(quad), patch, 0.45 if kind == "under" else 1.0)
    for sign in (-1, 1):
        model.add(_flank(plan, outline, inset, sign), patches[sign])
    if plan.style == "pickup":
        _bed(plan, model, top, rng)
    _wheels(plan, model, rng)
    mirror = box((-0.07, -0.09, 0), (0.07, 0.09, 0.13), bottom=True)
    x = (plan.cabin[0] - 0.5) * length - 0.12
    for sign in (-1, 1):
        model.add(mirror.moved((x, sign * (half + 0.07), plan.belt_m)), top)
    return (model.surface(),)


def _outline(plan: VehiclePlan) -> tuple[list[tuple[float, float]], NDArray[np.float64]]:
    """Side outline (x, z) from the front's foot over the roof to the rear, and its insets."""
    length = plan.length_m
    screen, front, rear, back = ((c - 0.5) * length for c in plan.cabin)
    nose = length / 2
    points = [
        (nose - 0.04, BOTTOM_M),
        (nose, 0.58 * plan.bonnet_m + 0.1),
        (nose - 0.12, plan.bonnet_m),
        (screen, plan.belt_m + 0.02),
        (front, plan.roof_m),
        (rear, plan.roof_m - 0.03),
        (back, plan.belt_m + 0.02),
        (-nose, plan.tail_m),
        (-nose + 0.03, BOTTOM_M),
    ]
    inset = np.array([0.06, 0.03, 0.06, 0.05, 0.2, 0.2, 0.05, 0.05, 0.05])
    if plan.style == "van":
        inset[4:6] = 0.1
    return points, inset


# What the strip from one point of the outline to the next is.
_STRIPS = ("front", "paint", "paint", "glass", "paint", "glass", "paint", "rear", "under")


def _flank(
    plan: VehiclePlan, outline: list[tuple[float, float]], inset: NDArray[np.float64], sign: int
) -> Part:
    """One side: the body below the belt and the cabin above it; uv by position."""
    half = plan.width_m / 2

    def face(indices: list[int]) -> Part:
        corners = [(outline[i][0], sign * (half - inset[i]), outline[i][1]) for i in indices]
        u = [c[0] / plan.length_m + 0.5 for c in corners]
        v = [c[2] / plan.roof_m for c in corners]
        if sign > 0:
            corners, u, v = corners[::-1], [1 - a for a in u[::-1]], v[::-1]
        return polygon(corners, list(zip(u, v, strict=True)))

    return join([face([0, 1, 2, 3]), face([0, 3, 6, 7, 8]), face([3, 4, 5, 6])])


def _bed(plan: VehiclePlan, model: Model, paint: int, rng: np.random.Generator) -> None:
    """A load on the pickup's bed."""
    length, half = plan.length_m, plan.width_m / 2 - 0.16
    x0, x1, z = -length / 2 + 0.15, (plan.cabin[3] - 0.5) * length - 0.08, plan.tail_m - 0.02
    tarp = model.patch(
        textures.wood(rng, (48, 96), textures.hsv(rng.uniform(20, 240), 0.35, 0.5), True)
    )
    model.add(box((x0, -half, z), (x1, half, z + 0.05)), tarp)
    for _ in range(int(rng.integers(0, 3))):
        size = rng.uniform(0.25, 0.55, 3)
        x, y = rng.uniform(x0, x1 - size[0]), rng.uniform(-half, half - size[1])
        model.add(box((x, y, z), (x + size[0], y + size[1], z + 0.05 + size[2])), tarp)


def _wheels(plan: VehiclePlan, model: Model, rng: np.random.Generator) -> None:
    patch = model.patch(vehicle_art.wheel(rng))
    tyre = model.patch(textures.plain(rng, (32, 32, 34)))
    radius = 0.33 if plan.style in ("car", "hatch", "estate") else 0.37
    for f in plan.axles:
        x = (f - 0.5) * plan.length_m
        for sign in (-1, 1):
            outer = sign * (plan.width_m / 2 + 0.02)
            inner = outer - sign * 0.2
            rim = tube((x, inner, radius), (x, outer, radius), radius, n=14, cap=True)
            side = len(rim.points) - 14
            model.add(Part(rim.points[:side], rim.faces[: 2 * 14], rim.uv[:side]), tyre)
            model.add(Part(rim.points[side:], rim.faces[2 * 14 :] - side, rim.uv[side:]), patch)
