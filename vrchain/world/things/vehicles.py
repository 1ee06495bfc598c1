"""Parked cars, vans and pickups: side outlines made solid, with wheels and painted details.

Model frame: the front towards +x, the middle at the origin, wheels on z = 0.
"""

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from vrchain.world import textures
from vrchain.world.model import Surface
from vrchain.world.shapes import Image, Model, Part, box, join, polygon
from vrchain.world.things import vehicle_art
from vrchain.world.things.vehicle_plans import BOTTOM_M, VehiclePlan


def build(plan: VehiclePlan, rng: Generator) -> tuple[Surface, ...]:
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

    x, z, inset = _outline(plan).T
    y = half - inset
    for i, kind in enumerate(_STRIPS):
        j = (i + 1) % len(_STRIPS)
        quad = [(x[i], -y[i], z[i]), (x[i], y[i], z[i]), (x[j], y[j], z[j]), (x[j], -y[j], z[j])]
        if i > 4:  # behind the roof's front the upper edge comes first: keep pictures upright
            quad = quad[2:] + quad[:2]
        patch: int | Image = glass if kind == "glass" else top
        if kind in ("front", "rear"):
            patch = vehicle_art.end(plan, rng, rgb, front=kind == "front")
        model.add(polygon(quad), patch, 0.45 if kind == "under" else 1.0)
    for sign in (-1, 1):
        model.add(_flank(plan, np.column_stack([x, sign * y, z]), sign), patches[sign])
    if plan.style == "pickup":
        _bed(plan, model, top, rng)
    _wheels(plan, model, rng)
    mirror = box((-0.07, -0.09, 0), (0.07, 0.09, 0.13), bottom=True)
    x = (plan.cabin[0] - 0.5) * length - 0.12
    for sign in (-1, 1):
        model.add(mirror.moved((x, sign * (half + 0.07), plan.belt_m)), top)
    return (model.surface(),)


def _outline(plan: VehiclePlan) -> NDArray[np.float64]:
    """The side from the front's foot over the roof to the rear: x, z and inset, (9, 3)."""
    screen, front, rear, back = ((c - 0.5) * plan.length_m for c in plan.cabin)
    nose, slim = plan.length_m / 2, 0.1 if plan.style == "van" else 0.2
    points = [
        (nose - 0.04, BOTTOM_M, 0.06),
        (nose, 0.58 * plan.bonnet_m + 0.1, 0.03),
        (nose - 0.12, plan.bonnet_m, 0.06),
        (screen, plan.belt_m + 0.02, 0.05),
        (front, plan.roof_m, slim),
        (rear, plan.roof_m - 0.03, slim),
        (back, plan.belt_m + 0.02, 0.05),
        (-nose, plan.tail_m, 0.05),
        (-nose + 0.03, BOTTOM_M, 0.05),
    ]
    return np.array(points)


# What the strip from one point of the outline to the next is.
_STRIPS = ("front", "paint", "paint", "glass", "paint", "glass", "paint", "rear", "under")


def _flank(plan: VehiclePlan, outline: NDArray[np.float64], sign: int) -> Part:
    """One side: the body below the belt and the cabin above it; uv by position."""
    uv = np.column_stack([outline[:, 0] / plan.length_m + 0.5, outline[:, 2] / plan.roof_m])
    if sign > 0:
        uv[:, 0] = 1 - uv[:, 0]
    faces = ([0, 1, 2, 3], [0, 3, 6, 7, 8], [3, 4, 5, 6])
    return join([polygon(outline[f], uv[f]) for f in (face[::-sign] for face in faces)])


def _bed(plan: VehiclePlan, model: Model, paint: int, rng: Generator) -> None:
    """A load on the pickup's bed."""
    length, half = plan.length_m, plan.width_m / 2 - 0.16
    x0, x1, z = -length / 2 + 0.15, (plan.cabin[3] - 0.5) * length - 0.08, plan.tail_m - 0.02
    rgb = textures.random_hsv(rng, (20, 240), 0.35, 0.5)
    tarp = model.patch(textures.wood(rng, (48, 96), rgb, along_x=True))
    model.add(box((x0, -half, z), (x1, half, z + 0.05)), tarp)
    for _ in range(int(rng.integers(0, 3))):
        size = rng.uniform(0.25, 0.55, 3)
        x, y = rng.uniform(x0, x1 - size[0]), rng.uniform(-half, half - size[1])
        model.add(box((x, y, z), (x + size[0], y + size[1], z + 0.05 + size[2])), tarp)


def _wheels(plan: VehiclePlan, model: Model, rng: Generator) -> None:
    patch = model.patch(vehicle_art.wheel(rng))
    tyre = model.patch(textures.plain(rng, (32, 32, 34)))
    radius = 0.33 if plan.style in ("car", "hatch", "estate") else 0.37
    for f in plan.axles:
        x = (f - 0.5) * plan.length_m
        for sign in (-1, 1):
            outer = sign * (plan.width_m / 2 + 0.02)
            ends = (x, outer - sign * 0.2, radius), (x, outer, radius)
            model.add_drum(*ends, radius, 14, tyre, patch)
