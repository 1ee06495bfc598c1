"""Parked cars, vans and pickups: side outlines made solid, with wheels and painted details.

Model frame: the front towards +x, the middle at the origin, wheels on z = 0.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from vrchain.world import textures
from vrchain.world.drawing import fill, frame
from vrchain.world.model import Surface
from vrchain.world.shapes import Image, Model, Part, box, join, polygon
from vrchain.world.textures import Colour, times

_BOTTOM_M = 0.24  # clearance under the body
_PX_PER_M = 60.0
_GLASS = (42.0, 52.0, 64.0)
_PILLARS = {  # between the windows, as fractions of the length from the rear
    "car": [0.44], "estate": [0.46, 0.26], "hatch": [0.44], "suv": [0.46, 0.26], "van": [0.66],
    "pickup": [0.52],
}  # fmt: skip
_FIRMS = (
    "MILLER & CO", "SUN BAKERY", "ROOFING 24", "POST", "GREEN GARDEN", "ELECTRO", "TAXI 4411",
    "PLUMBER", "PIZZA",
)  # fmt: skip


@dataclass(frozen=True)
class VehiclePlan:
    """Measures of a vehicle and the outline of its cabin as fractions of its length."""

    style: str  # "car", "estate", "hatch", "suv", "van" or "pickup"
    length_m: float
    width_m: float
    belt_m: float  # height of the windows' lower edge
    roof_m: float
    bonnet_m: float  # height of the front
    # Windscreen's foot, roof's front, roof's rear, rear window's foot; from the rear.
    cabin: tuple[float, float, float, float]
    tail_m: float  # height behind the cabin

    @property
    def name(self) -> str:
        """What a passer-by would call it: car, van or pickup."""
        return self.style if self.style in ("van", "pickup") else "car"

    @property
    def axles(self) -> tuple[float, float]:
        """Where the wheels are, from the rear, as fractions of the length."""
        return (0.2, 0.81) if self.style != "van" else (0.19, 0.83)


# length, width, belt, roof, bonnet, cabin, tail
_STYLES = {
    "car": (4.5, 1.78, 0.92, 1.43, 0.78, (0.70, 0.56, 0.30, 0.14), 0.9),
    "estate": (4.6, 1.8, 0.93, 1.48, 0.8, (0.71, 0.57, 0.08, 0.01), 0.93),
    "hatch": (3.8, 1.7, 0.92, 1.48, 0.8, (0.76, 0.60, 0.12, 0.01), 0.92),
    "suv": (4.55, 1.86, 1.06, 1.72, 1.0, (0.73, 0.61, 0.06, 0.01), 1.06),
    "van": (4.9, 1.95, 1.15, 2.1, 1.02, (0.88, 0.74, 0.01, 0.0), 1.15),
    "pickup": (5.0, 1.88, 1.05, 1.75, 1.0, (0.72, 0.61, 0.42, 0.38), 1.02),
}
_CHOICE = ("car", "car", "hatch", "hatch", "estate", "suv", "suv", "van", "pickup")


def draw_plan(rng: Generator) -> VehiclePlan:
    """A random vehicle."""
    style = str(rng.choice(_CHOICE))
    length, width, belt, roof, bonnet, cabin, tail = _STYLES[style]
    a, b, c, d = rng.uniform(0.96, 1.04, 4)
    return VehiclePlan(
        style, length * a, width * b, belt * c, roof * d, bonnet * c, cabin, tail * c
    )


def build(plan: VehiclePlan, rng: Generator) -> tuple[Surface, ...]:
    """A vehicle of a plan."""
    model = Model()
    rgb = _paint_rgb(rng)
    length, half = plan.length_m, plan.width_m / 2
    side = _side_picture(plan, rng, rgb)
    mirrored = side[:, ::-1].copy()
    if rng.random() < 0.4 or plan.style == "van":  # a firm's name, on both sides alike
        _lettering(plan, side, rgb, front_right=True)
        _lettering(plan, mirrored, rgb, front_right=False)
    patches = {1: model.patch(mirrored), -1: model.patch(side)}
    top = model.patch(textures.plain(rng, rgb, (40, 40), 0.02))
    glass = model.patch(_screen_picture(rng))

    x, z, inset = _outline(plan).T
    y = half - inset
    for i, kind in enumerate(_STRIPS):
        j = (i + 1) % len(_STRIPS)
        quad = [(x[i], -y[i], z[i]), (x[i], y[i], z[i]), (x[j], y[j], z[j]), (x[j], -y[j], z[j])]
        if i > 4:  # behind the roof's front the upper edge comes first: keep pictures upright
            quad = quad[2:] + quad[:2]
        patch: int | Image = glass if kind == "glass" else top
        if kind in ("front", "rear"):
            patch = _end_picture(plan, rng, rgb, front=kind == "front")
        model.add(polygon(quad), patch, 0.45 if kind == "under" else 1.0)
    for sign in (-1, 1):
        model.add(_flank(plan, np.column_stack([x, sign * y, z]), sign), patches[sign])
    if plan.style == "pickup":
        _bed(plan, model, rng)
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
        (nose - 0.04, _BOTTOM_M, 0.06),
        (nose, 0.58 * plan.bonnet_m + 0.1, 0.03),
        (nose - 0.12, plan.bonnet_m, 0.06),
        (screen, plan.belt_m + 0.02, 0.05),
        (front, plan.roof_m, slim),
        (rear, plan.roof_m - 0.03, slim),
        (back, plan.belt_m + 0.02, 0.05),
        (-nose, plan.tail_m, 0.05),
        (-nose + 0.03, _BOTTOM_M, 0.05),
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


def _bed(plan: VehiclePlan, model: Model, rng: Generator) -> None:
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
    patch = model.patch(_wheel_picture(rng))
    tyre = model.patch(textures.plain(rng, (32, 32, 34)))
    radius = 0.33 if plan.style in ("car", "hatch", "estate") else 0.37
    for f in plan.axles:
        x = (f - 0.5) * plan.length_m
        for sign in (-1, 1):
            outer = sign * (plan.width_m / 2 + 0.02)
            ends = (x, outer - sign * 0.2, radius), (x, outer, radius)
            model.add_drum(*ends, radius, 14, tyre, patch)


def _paint_rgb(rng: Generator) -> Colour:
    """White to grey, or one of the colours that cars have."""
    if rng.random() < 0.35:
        return textures.hsv(rng.uniform(0, 360), 0.03, rng.choice([0.95, 0.8, 0.6, 0.35]))
    hue = rng.choice([0, 3, 12, 28, 48, 95, 150, 185, 208, 220, 228, 340]) + rng.uniform(-7, 7)
    return textures.random_hsv(rng, hue, (0.4, 0.85), (0.35, 0.85))


def _side_picture(plan: VehiclePlan, rng: Generator, rgb: Colour) -> Image:
    """The right side (front at the picture's right)."""
    h, w = round(plan.roof_m * _PX_PER_M), round(plan.length_m * _PX_PER_M)
    image = textures.plain(rng, rgb, (h, w), 0.02)
    dark, style = times(rgb, 0.45), plan.style

    def at(fraction: float, z_m: float) -> tuple[int, int]:
        return round(fraction * w), round(h - z_m * _PX_PER_M)

    def bar(rear: float, top_m: float, front: float, bottom_m: float, rgb: Colour) -> None:
        fill(image, (*at(rear, top_m), *at(front, bottom_m)), rgb)

    _panes(plan, image, at)
    pillars = _PILLARS[style]
    doors = [*pillars, plan.cabin[0] - 0.05, *([] if style in ("pickup", "van") else [0.24])]
    for f in doors:
        cv2.line(image, at(f, plan.belt_m + 0.04), at(f, _BOTTOM_M + 0.12), dark, 1)
    for f in [*pillars[:1], *([0.27] if style in ("car", "hatch") else [])]:  # handles
        bar(f + 0.015, plan.belt_m - 0.08, f + 0.05, plan.belt_m - 0.12, (30, 30, 30))
    cv2.line(image, at(0.0, plan.belt_m - 0.2), at(1.0, plan.belt_m - 0.24), dark, 1, cv2.LINE_AA)
    bar(0, _BOTTOM_M + 0.1, 1, _BOTTOM_M, (40, 40, 42))
    if rng.random() < 0.35:
        stripe = textures.random_hsv(rng, (0, 360), (0, 0.9), 0.9)
        z = rng.uniform(0.45, 0.65)
        bar(0, z, 1, z - rng.uniform(0.04, 0.12), stripe)
    for f in plan.axles:
        cv2.circle(image, at(f, 0.33), round(0.4 * _PX_PER_M), (25, 25, 27), -1, cv2.LINE_AA)
    bar(0.965, 0.66, 1, 0.54, (245, 240, 220))
    bar(0, plan.tail_m - 0.12, 0.035, plan.tail_m - 0.3, (175, 25, 25))
    return image


def _panes(plan: VehiclePlan, image: Image, at: Callable[[float, float], tuple[int, int]]) -> None:
    """Side windows between the slanting ends of the cabin and the pillars."""
    screen, front, rear, back = plan.cabin
    top, foot = plan.roof_m - 0.1, plan.belt_m + 0.04
    edges = [(screen - 0.035, front - 0.015), *((p, p) for p in _PILLARS[plan.style])]
    if plan.style != "van":  # it has a closed load bay
        edges.append((back + 0.05, rear + 0.015))
    for (right_low, right_high), (left_low, left_high) in itertools.pairwise(edges):
        corners = [
            at(left_low + 0.008, foot),
            at(right_low - 0.008, foot),
            at(right_high - 0.008, top),
            at(left_high + 0.008, top),
        ]
        outline = np.array(corners, dtype=np.int32)
        cv2.fillPoly(image, [outline], _GLASS, cv2.LINE_AA)
        a, b = at((left_low + right_low) / 2, foot), at((left_high + right_high) / 2 + 0.03, top)
        cv2.line(image, a, b, (110, 125, 140), 2, cv2.LINE_AA)
        cv2.polylines(image, [outline], True, (20, 20, 22), 1, cv2.LINE_AA)


def _lettering(plan: VehiclePlan, image: Image, rgb: Colour, *, front_right: bool) -> None:
    """A firm's name on a side whose front is at the picture's right or left."""
    h, w = image.shape[:2]
    word = _FIRMS[int(sum(rgb) * 7) % len(_FIRMS)]
    ink = (250, 245, 235) if sum(rgb) < 380 else (150, 25, 40)
    font, scale, z = cv2.FONT_HERSHEY_DUPLEX, 0.5, 0.7
    behind = 1.0
    if plan.style == "van":
        scale, z, behind = 0.95, 1.45, 0.82  # clear of its front door
    size = cv2.getTextSize(word, font, scale, 2)[0][0]
    at = int((behind if front_right else 2 - behind) * (w - size) / 2), int(h - z * _PX_PER_M)
    cv2.putText(image, word, at, font, scale, ink, 2, cv2.LINE_AA)


def _end_picture(plan: VehiclePlan, rng: Generator, rgb: Colour, *, front: bool) -> Image:
    """Front or rear as seen from before it, from the vehicle's foot to its bonnet or tail."""
    w, h = round(plan.width_m * _PX_PER_M), 44
    image = textures.plain(rng, rgb, (h, w), 0.02)
    fill(image, (0, h - 9, w, h), (45, 45, 47))
    lamp = (245, 240, 215) if front else (190, 25, 25)
    wide = int(rng.integers(12, 22))
    for x in (3, w - 3 - wide):
        fill(image, (x, 8, x + wide, 18), lamp)
        frame(image, (x, 8, x + wide, 18), (40, 40, 40))
    if front:
        for y in range(9, 20, 3):
            cv2.line(image, (wide + 10, y), (w - wide - 10, y), (35, 35, 38), 2)
    plate = textures.hsv(rng.choice([50, 55, 0]), rng.choice([0.0, 0.6]), 0.97)
    x = w // 2 - 16
    fill(image, (x, 22, x + 33, 32), plate)
    text = "".join(chr(65 + int(c)) for c in rng.integers(0, 26, 2)) + str(rng.integers(100, 999))
    cv2.putText(image, text, (x + 1, 30), cv2.FONT_HERSHEY_PLAIN, 0.62, (20, 20, 25), 1)
    return image


def _screen_picture(rng: Generator) -> Image:
    """A windscreen or rear window, the sky mirrored in it."""
    image = textures.plain(rng, _GLASS, (32, 64), 0.1)
    cv2.line(image, (8, 31), (30, 0), (120, 135, 150), 5, cv2.LINE_AA)
    cv2.line(image, (20, 31), (42, 0), (95, 110, 125), 2, cv2.LINE_AA)
    frame(image, (0, 0, 63, 31), (22, 22, 24), 2)
    return image


def _wheel_picture(rng: Generator) -> Image:
    """A tyre and rim from the side."""
    hub = np.full((40, 40, 3), 28, dtype=np.uint8)
    metal = textures.hsv(0, 0, rng.uniform(0.55, 0.9))
    cv2.circle(hub, (20, 20), 13, metal, -1, cv2.LINE_AA)
    spokes = int(rng.integers(4, 9))
    for k in range(spokes):
        angle = 2 * np.pi * k / spokes
        end = (20 + round(12 * np.cos(angle)), 20 + round(12 * np.sin(angle)))
        cv2.line(hub, (20, 20), end, (50, 50, 52), 2, cv2.LINE_AA)
    cv2.circle(hub, (20, 20), 3, (60, 60, 62), -1)
    return hub
