"""What is painted on vehicles: sides with windows and doors, lights, plates, a firm's name."""

import itertools
from collections.abc import Callable

import cv2
import numpy as np
from numpy.random import Generator

from vrchain.world import textures
from vrchain.world.drawing import fill, frame
from vrchain.world.shapes import Image
from vrchain.world.textures import Colour, times
from vrchain.world.things.vehicle_plans import BOTTOM_M, VehiclePlan

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


def paint_rgb(rng: Generator) -> Colour:
    """White to grey, or one of the colours that cars have."""
    if rng.random() < 0.35:
        return textures.hsv(rng.uniform(0, 360), 0.03, rng.choice([0.95, 0.8, 0.6, 0.35]))
    hue = rng.choice([0, 3, 12, 28, 48, 95, 150, 185, 208, 220, 228, 340]) + rng.uniform(-7, 7)
    return textures.random_hsv(rng, hue, (0.4, 0.85), (0.35, 0.85))


def side(plan: VehiclePlan, rng: Generator, rgb: Colour) -> Image:
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
        cv2.line(image, at(f, plan.belt_m + 0.04), at(f, BOTTOM_M + 0.12), dark, 1)
    for f in [*pillars[:1], *([0.27] if style in ("car", "hatch") else [])]:  # handles
        bar(f + 0.015, plan.belt_m - 0.08, f + 0.05, plan.belt_m - 0.12, (30, 30, 30))
    cv2.line(image, at(0.0, plan.belt_m - 0.2), at(1.0, plan.belt_m - 0.24), dark, 1, cv2.LINE_AA)
    bar(0, BOTTOM_M + 0.1, 1, BOTTOM_M, (40, 40, 42))
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


def lettering(plan: VehiclePlan, image: Image, rgb: Colour, *, front_right: bool) -> None:
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


def end(plan: VehiclePlan, rng: Generator, rgb: Colour, *, front: bool) -> Image:
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


def screen(rng: Generator) -> Image:
    """A windscreen or rear window, the sky mirrored in it."""
    image = textures.plain(rng, _GLASS, (32, 64), 0.1)
    cv2.line(image, (8, 31), (30, 0), (120, 135, 150), 5, cv2.LINE_AA)
    cv2.line(image, (20, 31), (42, 0), (95, 110, 125), 2, cv2.LINE_AA)
    frame(image, (0, 0, 63, 31), (22, 22, 24), 2)
    return image


def wheel(rng: Generator) -> Image:
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
