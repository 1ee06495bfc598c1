"""Street furniture: lamps, poles, signs, mailboxes, bins, hydrants.

Model frame: standing at the origin; what looks at the street (a lamp's arm, a sign's face, a
mailbox's door) looks towards -y.
"""

import itertools

import cv2
import numpy as np
from numpy.random import Generator

from vrchain.world import textures
from vrchain.world.drawing import fill, frame
from vrchain.world.model import Surface
from vrchain.world.shapes import Image, Model, Part, blob, box, join, polygon, tube
from vrchain.world.textures import Colour, Shape, hsv, plain, random_hsv

_Surfaces = tuple[Surface, ...]
_BLACK, _WHITE, _RED = (15, 15, 15), (250, 250, 250), (200, 25, 35)


def _upright(
    low_m: float, high_m: float, radius_m: float, end_radius_m: float | None = None, n: int = 8
) -> Part:
    """A rod on the z axis, closed at its top."""
    return tube((0, 0, low_m), (0, 0, high_m), radius_m, end_radius_m, n, cap=True)


def _text(
    image: Image, words: str, at: tuple[int, int], size: float, rgb: Colour, thick_px: int = 1
) -> None:
    font = cv2.FONT_HERSHEY_DUPLEX
    cv2.putText(image, words, at, font, size, rgb, thick_px, cv2.LINE_AA)


def _band(rng: Generator, rgb: Colour, shape: Shape = (128, 24)) -> Image:
    """Painted metal, weathered, with a sticker or two and a number: every post differs."""
    image = plain(rng, rgb, shape, 0.08)
    h, w = shape
    for _ in range(int(rng.integers(1, 4))):
        y = int(rng.uniform(0.55, 0.9) * h)
        colour = random_hsv(rng, (0, 360), (0.2, 0.9), (0.5, 1))
        x = int(rng.integers(0, max(1, w - 8)))
        fill(image, (x, y, x + 7, y + int(rng.integers(3, 8))), colour)
    return image


def lamp(rng: Generator) -> _Surfaces:
    """A street lamp: an arm over the street, or a lantern on top."""
    model = Model()
    rgb = hsv(rng.uniform(0, 360), rng.choice([0.05, 0.45]), rng.uniform(0.25, 0.6))
    metal = model.patch(_band(rng, rgb))
    glow = model.patch(plain(rng, (250, 245, 215), (16, 16), 0.03))
    if rng.random() < 0.55:
        z, reach = rng.uniform(4.6, 5.6), rng.uniform(0.9, 1.5)
        model.add(_upright(0, 0.9, 0.1, 0.09), metal)
        model.add(_upright(0.9, z, 0.065, 0.05), metal)
        model.add(tube((0, 0, z), (0, -reach, z + 0.25), 0.045, n=6), metal)
        low, high = (-0.13, -reach - 0.5, z + 0.2), (0.13, -reach + 0.05, z + 0.33)
        model.add(box(low, high, bottom=True), metal)
        low, high = (-0.11, -reach - 0.48, z + 0.16), (0.11, -reach, z + 0.2)
        model.add(box(low, high, bottom=True), glow)
    else:
        z = rng.uniform(3.0, 3.8)
        model.add(_upright(0, 0.35, 0.14, 0.1), metal)
        model.add(tube((0, 0, 0.35), (0, 0, z), 0.06), metal)
        model.add(_upright(z + 0.4, z, 0.19, 0.1, 6), glow)
        model.add(_upright(z + 0.62, z + 0.4, 0.02, 0.23, 6), metal)
    plate = np.full((20, 28, 3), 240, dtype=np.uint8)
    number, font = str(rng.integers(10, 99)), cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(plate, number, (2, 15), font, 0.45, (20, 20, 60), 1, cv2.LINE_AA)
    model.add(box((-0.14, -0.12, 1.5), (0.14, 0.12, 1.7), bottom=True), plate)
    return (model.surface(),)


def pole(rng: Generator) -> _Surfaces:
    """A wooden utility pole with cross-arms and insulators, along x."""
    model = Model()
    height = rng.uniform(6.5, 8.0)
    wood = textures.wood(rng, (256, 32), random_hsv(rng, (18, 35), (0.25, 0.45), (0.32, 0.5)))
    wooden = model.patch(wood)
    model.add(_upright(0, height, 0.15, 0.1), wooden)
    grey = model.patch(plain(rng, (190, 195, 200), (16, 16)))
    for z in height - 0.4 - 0.6 * np.arange(int(rng.integers(1, 3))):
        half = rng.uniform(0.7, 1.0)
        model.add(box((-half, -0.17, z), (half, -0.08, z + 0.12), bottom=True), wooden)
        for x in np.linspace(-half + 0.1, half - 0.1, 4):
            model.add(tube((x, -0.12, z + 0.12), (x, -0.12, z + 0.28), 0.04, 0.02, n=5), grey)
    if rng.random() < 0.5:
        z = height - rng.uniform(1.6, 2.0)
        model.add(tube((0.0, -0.38, z - 0.7), (0.0, -0.38, z), 0.22, n=10, cap=True), grey)
    poster = model.patch(_poster(rng, (40, 28)))
    z = rng.uniform(1.1, 1.5)
    model.add(box((-0.17, -0.165, z), (0.17, -0.02, z + 0.45), sides="flr"), poster)
    return (model.surface(),)


def _poster(rng: Generator, shape: Shape) -> Image:
    h, w = shape
    image = plain(rng, random_hsv(rng, (0, 360), (0, 0.7), 0.95), shape, 0.03)
    for y in range(4, h - 4, 5):
        ink = random_hsv(rng, (0, 360), 0.7, (0.1, 0.6))
        start, end = int(rng.integers(2, w // 2)), int(rng.integers(w // 2, w - 2))
        cv2.line(image, (start, y), (end, y), ink, int(rng.integers(1, 4)))
    frame(image, (0, 0, w - 1, h - 1), (40, 40, 40))
    return image


_WORDS = (
    "OAK", "ELM", "MILL", "PARK", "HILL", "LAKE", "ROSE", "KING", "WEST", "NORTH", "CHURCH",
    "GARDEN", "MAPLE",
)  # fmt: skip


def sign(rng: Generator) -> _Surfaces:
    """A road sign: round, triangular or eight-sided plate, or a street name, on a grey post."""
    model = Model()
    post = model.patch(_band(rng, (150, 152, 156), (96, 16)))
    height = rng.uniform(2.1, 2.5)
    model.add(_upright(0, height, 0.04, n=7), post)
    back = model.patch(plain(rng, (140, 142, 145), (16, 16)))
    style = int(rng.integers(4))
    if style == 3:
        face, half = _name_plate(rng), np.array([0.55, 0.16])
        corners = half * [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    else:
        face, half = (_round, _triangle, _stop)[style](rng), np.array([0.36, 0.36])
        n, turn = ((24, 0.0), (3, np.pi / 2), (8, np.pi / 8))[style]
        angle = turn + 2 * np.pi * np.arange(n) / n
        corners = half * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    z = height - half[1] + 0.12
    flat = np.column_stack([corners[:, 0], np.full(len(corners), -0.06), z + corners[:, 1]])
    uv = 0.5 + 0.5 * corners / half
    model.add(polygon(flat, uv), face)
    model.add(polygon((flat + np.array([0, 0.02, 0]))[::-1], uv[::-1]), back)
    return (model.surface(),)


def _face(rng: Generator, rgb: Colour) -> tuple[Image, str]:
    """A road sign's face to draw on, 72 x 72, and the number that it may show."""
    return np.full((72, 72, 3), rgb, dtype=np.uint8), str(rng.choice(["20", "30", "40", "50"]))


def _round(rng: Generator) -> Image:
    """A speed limit, or "ahead only"."""
    image, limit = _face(rng, (245, 245, 245))
    blue = rng.random() < 0.4
    cv2.circle(image, (36, 36), 36, (30, 70, 170) if blue else _RED, -1, cv2.LINE_AA)
    if blue:
        cv2.arrowedLine(image, (36, 58), (36, 16), _WHITE, 7, cv2.LINE_AA, tipLength=0.4)
    else:
        cv2.circle(image, (36, 36), 27, _WHITE, -1, cv2.LINE_AA)
        _text(image, limit, (14, 47), 1.1, _BLACK, 2)
    return image


def _triangle(rng: Generator) -> Image:
    """A warning of danger, or of people."""
    image, _ = _face(rng, _RED)
    inner = np.array([(36, 14), (16, 47), (56, 47)], dtype=np.int32)
    cv2.fillPoly(image, [inner], _WHITE, cv2.LINE_AA)
    if rng.random() < 0.5:
        cv2.line(image, (36, 24), (36, 36), _BLACK, 5)
        cv2.circle(image, (36, 43), 3, _BLACK, -1)
    else:
        cv2.circle(image, (36, 28), 4, _BLACK, -1)
        cv2.line(image, (36, 30), (32, 45), _BLACK, 4)
        cv2.line(image, (36, 34), (42, 44), _BLACK, 3)
    return image


def _stop(rng: Generator) -> Image:
    image, _ = _face(rng, _RED)
    _text(image, "STOP", (8, 43), 0.72, _WHITE, 2)
    return image


def _name_plate(rng: Generator) -> Image:
    image = np.empty((36, 128, 3), dtype=np.uint8)
    image[:] = hsv(rng.choice([120, 220, 150, 0]), 0.75, 0.42)
    frame(image, (2, 2, 125, 33), (245, 245, 245))
    text = f"{rng.choice(_WORDS)} {rng.choice(['ST', 'RD', 'AVE', 'LN'])}"
    width = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 0.6, 1)[0][0]
    _text(image, text, ((128 - width) // 2, 24), 0.6, _WHITE)
    return image


def mailbox(rng: Generator) -> _Surfaces:
    """A box with a rounded top on a post, a number on its sides and a flag."""
    model = Model()
    wood = model.patch(textures.wood(rng, (40, 12), random_hsv(rng, (15, 40), 0.4, (0.4, 0.9))))
    rgb = hsv(rng.uniform(0, 360), rng.choice([0.05, 0.7]), rng.uniform(0.3, 0.9))
    base = rng.uniform(0.9, 1.05)
    model.add(box((-0.05, -0.05, 0), (0.05, 0.05, base)), wood)
    w, depth, h = rng.uniform(0.11, 0.15), rng.uniform(0.24, 0.3), rng.uniform(0.17, 0.24)
    top = base + h
    side = plain(rng, rgb, (28, 56), 0.05)
    ink = (245, 245, 240) if sum(rgb) < 380 else (20, 20, 30)
    _text(side, str(rng.integers(1, 400)), (6, 21), 0.62, ink)
    front = plain(rng, rgb, (32, 32), 0.05)
    frame(front, (4, 4, 27, 28), ink)
    cv2.line(front, (12, 8), (20, 8), ink, 2)
    low, high = (-w, -depth, base), (w, depth, top)
    model.add(box(low, high, sides="lr", top=False), side)
    model.add(box(low, high, sides="fb", top=False, bottom=True), front)
    paint = model.patch(plain(rng, textures.times(rgb, 0.9), (16, 16)))
    turn = np.linspace(0, np.pi, 7)
    arch = np.stack([w * np.cos(turn), top + 0.75 * w * np.sin(turn)], axis=1)
    strips = [
        polygon([(xa, -depth, za), (xa, depth, za), (xb, depth, zb), (xb, -depth, zb)])
        for (xa, za), (xb, zb) in itertools.pairwise(arch)
    ]
    ends = [polygon(np.insert(xz, 1, y, 1)) for xz, y in ((arch, -depth), (arch[::-1], depth))]
    model.add(join(strips), paint)
    model.add(join(ends), paint)
    flag = model.patch(plain(rng, (205, 35, 35), (8, 8)))
    for y, z in ((-0.02, top), (0.07, top + 0.15)):
        model.add(box((w, -0.05, z), (w + 0.02, y, top + 0.22), bottom=True), flag)
    return (model.surface(),)


def wheelie_bin(rng: Generator) -> _Surfaces:
    """A wheeled bin with a lid, a number and a sticker."""
    model = Model()
    hue = rng.choice([110, 150, 215, 30, 0, 55]) + rng.uniform(-10, 10)
    rgb = random_hsv(rng, hue, (0.3, 0.8), (0.3, 0.65))
    image = plain(rng, rgb, (64, 40), 0.06)
    for y in (8, 52):
        cv2.line(image, (0, y), (40, y), textures.times(rgb, 0.6), 2)
    image[16:34, 9:31] = _poster(rng, (18, 22))
    number, font = str(rng.integers(1, 400)), cv2.FONT_HERSHEY_PLAIN
    cv2.putText(image, number, (6, 48), font, 0.9, (245, 245, 245), 1)
    body = box((-0.29, -0.29, 0.0), (0.29, 0.29, 0.95))
    body.points[body.points[:, 2] < 0.1, :2] *= 0.82
    model.add(body, image)
    lid_rgb = rgb if rng.random() < 0.5 else random_hsv(rng, (0, 360), 0.7, 0.6)
    lid = model.patch(plain(rng, lid_rgb, (24, 24), 0.08))
    model.add(box((-0.32, -0.34, 0.95), (0.32, 0.33, 1.03), bottom=True), lid)
    model.add(box((-0.25, 0.33, 0.9), (0.25, 0.39, 0.97), bottom=True), lid)
    return (model.surface(),)


def hydrant(rng: Generator) -> _Surfaces:
    """A fire hydrant with a domed cap and two outlets."""
    model = Model()
    rgb = random_hsv(rng, rng.choice([0, 8, 45, 215]), (0.7, 0.95), (0.65, 0.9))
    body = model.patch(_band(rng, rgb, (48, 48)))
    cap_rgb = hsv(rng.uniform(0, 360), rng.choice([0.0, 0.7]), 0.85)
    cap = model.patch(plain(rng, cap_rgb, (24, 24), 0.08))
    model.add(_upright(0, 0.08, 0.18, n=10), cap)
    model.add(tube((0, 0, 0.08), (0, 0, 0.6), 0.125, 0.11, n=10), body)
    model.add(_upright(0.55, 0.62, 0.155, n=10), cap)
    model.add(blob((0, 0, 0.62), (0.125, 0.125, 0.16), n=10, rings=6), body)
    for end, radius in (((-0.22, 0), 0.06), ((0.22, 0), 0.06), ((0, -0.22), 0.08)):
        z = 0.45 if radius < 0.08 else 0.38
        model.add(tube((0, 0, z), (*end, z), radius, n=8, cap=True), cap)
    return (model.surface(),)
