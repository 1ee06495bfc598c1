"""Street furniture: lamps, poles, signs, mailboxes, bins, hydrants.

Model frame: standing at the origin; what looks at the street (a lamp's arm, a sign's face, a
mailbox's door) looks towards -y.
"""

import itertools

import cv2
import numpy as np

from vrchain.world import textures
from vrchain.world.model import Surface
from vrchain.world.shapes import Image, Model, blob, box, join, polygon, tube

_Surfaces = tuple[Surface, ...]


def _band(
    rng: np.random.Generator, rgb: textures.Colour, shape: tuple[int, int] = (128, 24)
) -> Image:
    """Painted metal, weathered, with a sticker or two and a number: every post differs."""
    image = textures.plain(rng, rgb, shape, 0.08)
    h, w = shape
    for _ in range(int(rng.integers(1, 4))):
        y = int(rng.uniform(0.55, 0.9) * h)
        colour = textures.hsv(rng.uniform(0, 360), rng.uniform(0.2, 0.9), rng.uniform(0.5, 1))
        x = int(rng.integers(0, max(1, w - 8)))
        cv2.rectangle(image, (x, y), (x + 7, y + int(rng.integers(3, 8))), colour, -1)
    return image


def lamp(rng: np.random.Generator) -> _Surfaces:
    """A street lamp: an arm over the street, or a lantern on top."""
    model = Model()
    rgb = textures.hsv(rng.uniform(0, 360), rng.choice([0.05, 0.45]), rng.uniform(0.25, 0.6))
    metal = model.patch(_band(rng, rgb))
    glow = model.patch(textures.plain(rng, (250, 245, 215), (16, 16), 0.03))
    if rng.random() < 0.55:
        height, reach = rng.uniform(4.6, 5.6), rng.uniform(0.9, 1.5)
        model.add(tube((0, 0, 0), (0, 0, 0.9), 0.1, 0.09, cap=True), metal)
        model.add(tube((0, 0, 0.9), (0, 0, height), 0.065, 0.05, cap=True), metal)
        model.add(tube((0, 0, height), (0, -reach, height + 0.25), 0.045, n=6), metal)
        model.add(
            box(
                (-0.13, -reach - 0.5, height + 0.2),
                (0.13, -reach + 0.05, height + 0.33),
                bottom=True,
            ),
            metal,
        )
        head = box((-0.11, -reach - 0.48, height + 0.16), (0.11, -reach, height + 0.2), bottom=True)
        model.add(head, glow)
    else:
        height = rng.uniform(3.0, 3.8)
        model.add(tube((0, 0, 0), (0, 0, 0.35), 0.14, 0.1, cap=True), metal)
        model.add(tube((0, 0, 0.35), (0, 0, height), 0.06), metal)
        model.add(tube((0, 0, height + 0.4), (0, 0, height), 0.19, 0.1, n=6, cap=True), glow)
        model.add(
            tube((0, 0, height + 0.62), (0, 0, height + 0.4), 0.02, 0.23, n=6, cap=True), metal
        )
    plate = np.full((20, 28, 3), 240, dtype=np.uint8)
    number = str(rng.integers(10, 99))
    cv2.putText(
        plate, number, (2, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (20, 20, 60), 1, cv2.LINE_AA
    )
    model.add(box((-0.14, -0.12, 1.5), (0.14, 0.12, 1.7), bottom=True), model.patch(plate))
    return (model.surface(),)


def pole(rng: np.random.Generator) -> _Surfaces:
    """A wooden utility pole with cross-arms and insulators, along x."""
    model = Model()
    height = rng.uniform(6.5, 8.0)
    rgb = textures.hsv(rng.uniform(18, 35), rng.uniform(0.25, 0.45), rng.uniform(0.32, 0.5))
    wood = model.patch(textures.wood(rng, (256, 32), rgb))
    model.add(tube((0, 0, 0), (0, 0, height), 0.15, 0.1, cap=True), wood)
    grey = model.patch(textures.plain(rng, (190, 195, 200), (16, 16)))
    for z in height - 0.4 - 0.6 * np.arange(int(rng.integers(1, 3))):
        half = rng.uniform(0.7, 1.0)
        model.add(box((-half, -0.17, z), (half, -0.08, z + 0.12), bottom=True), wood)
        for x in np.linspace(-half + 0.1, half - 0.1, 4):
            model.add(tube((x, -0.12, z + 0.12), (x, -0.12, z + 0.28), 0.04, 0.02, n=5), grey)
    if rng.random() < 0.5:
        z = height - rng.uniform(1.6, 2.0)
        model.add(tube((0.0, -0.38, z - 0.7), (0.0, -0.38, z), 0.22, n=10, cap=True), grey)
    poster = model.patch(_poster(rng, (40, 28)))
    z = rng.uniform(1.1, 1.5)
    model.add(box((-0.17, -0.165, z), (0.17, -0.02, z + 0.45), sides="flr"), poster)
    return (model.surface(),)


def _poster(rng: np.random.Generator, shape: tuple[int, int]) -> Image:
    h, w = shape
    image = textures.plain(
        rng, textures.hsv(rng.uniform(0, 360), rng.uniform(0, 0.7), 0.95), shape, 0.03
    )
    for y in range(4, h - 4, 5):
        ink = textures.hsv(rng.uniform(0, 360), 0.7, rng.uniform(0.1, 0.6))
        x0 = int(rng.integers(2, w // 2))
        cv2.line(
            image, (x0, y), (int(rng.integers(w // 2, w - 2)), y), ink, int(rng.integers(1, 4))
        )
    cv2.rectangle(image, (0, 0), (w - 1, h - 1), (40, 40, 40), 1)
    return image


_WORDS = (
    "OAK",
    "ELM",
    "MILL",
    "PARK",
    "HILL",
    "LAKE",
    "ROSE",
    "KING",
    "WEST",
    "NORTH",
    "CHURCH",
    "GARDEN",
    "MAPLE",
)


def sign(rng: np.random.Generator) -> _Surfaces:
    """A road sign: round, triangular or eight-sided plate, or a street name, on a grey post."""
    model = Model()
    post = model.patch(_band(rng, (150, 152, 156), (96, 16)))
    height = rng.uniform(2.1, 2.5)
    model.add(tube((0, 0, 0), (0, 0, height), 0.04, n=7, cap=True), post)
    back = model.patch(textures.plain(rng, (140, 142, 145), (16, 16)))
    style = int(rng.integers(4))
    if style == 3:
        face, half_w, half_h = _name_plate(rng), 0.55, 0.16
        corners = np.array(
            [(-half_w, -half_h), (half_w, -half_h), (half_w, half_h), (-half_w, half_h)]
        )
    else:
        n, turn = ((24, 0.0), (3, np.pi / 2), (8, np.pi / 8))[style]
        angle = turn + 2 * np.pi * np.arange(n) / n
        half_w = half_h = 0.36
        corners = half_w * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        face = _plate(rng, style)
    z = height - half_h + 0.12
    flat = np.column_stack([corners[:, 0], np.full(len(corners), -0.06), z + corners[:, 1]])
    uv = 0.5 + 0.5 * corners / (half_w, half_h)
    model.add(polygon(flat, uv), model.patch(face))
    model.add(polygon((flat + np.array([0, 0.02, 0]))[::-1], uv[::-1]), back)
    return (model.surface(),)


def _plate(rng: np.random.Generator, style: int) -> Image:
    """The face of a road sign in a 72 x 72 picture."""
    image = np.full((72, 72, 3), 245, dtype=np.uint8)
    red, c = (200, 25, 35), (36, 36)
    text = str(rng.choice(["20", "30", "40", "50"]))
    if style == 0:
        blue = rng.random() < 0.4
        cv2.circle(image, c, 36, (30, 70, 170) if blue else red, -1, cv2.LINE_AA)
        if blue:
            cv2.arrowedLine(
                image, (36, 58), (36, 16), (250, 250, 250), 7, cv2.LINE_AA, tipLength=0.4
            )
        else:
            cv2.circle(image, c, 27, (250, 250, 250), -1, cv2.LINE_AA)
            cv2.putText(
                image, text, (14, 47), cv2.FONT_HERSHEY_DUPLEX, 1.1, (15, 15, 15), 2, cv2.LINE_AA
            )
    elif style == 1:
        image[:] = red
        inner = np.array([(36, 14), (16, 47), (56, 47)], dtype=np.int32)
        cv2.fillPoly(image, [inner], (250, 250, 250), cv2.LINE_AA)
        if rng.random() < 0.5:
            cv2.line(image, (36, 24), (36, 36), (15, 15, 15), 5)
            cv2.circle(image, (36, 43), 3, (15, 15, 15), -1)
        else:
            cv2.circle(image, (36, 28), 4, (15, 15, 15), -1)
            cv2.line(image, (36, 30), (32, 45), (15, 15, 15), 4)
            cv2.line(image, (36, 34), (42, 44), (15, 15, 15), 3)
    else:
        image[:] = red
        cv2.putText(
            image, "STOP", (8, 43), cv2.FONT_HERSHEY_DUPLEX, 0.72, (250, 250, 250), 2, cv2.LINE_AA
        )
    return image


def _name_plate(rng: np.random.Generator) -> Image:
    image = np.empty((36, 128, 3), dtype=np.uint8)
    image[:] = textures.hsv(rng.choice([120, 220, 150, 0]), 0.75, 0.42)
    cv2.rectangle(image, (2, 2), (125, 33), (245, 245, 245), 1)
    text = f"{rng.choice(_WORDS)} {rng.choice(['ST', 'RD', 'AVE', 'LN'])}"
    width = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 0.6, 1)[0][0]
    cv2.putText(
        image,
        text,
        ((128 - width) // 2, 24),
        cv2.FONT_HERSHEY_DUPLEX,
        0.6,
        (250, 250, 250),
        1,
        cv2.LINE_AA,
    )
    return image


def mailbox(rng: np.random.Generator) -> _Surfaces:
    """A box with a rounded top on a post, a number on its sides and a flag."""
    model = Model()
    wood = model.patch(
        textures.wood(rng, (40, 12), textures.hsv(rng.uniform(15, 40), 0.4, rng.uniform(0.4, 0.9)))
    )
    rgb = textures.hsv(rng.uniform(0, 360), rng.choice([0.05, 0.7]), rng.uniform(0.3, 0.9))
    base = rng.uniform(0.9, 1.05)
    model.add(box((-0.05, -0.05, 0), (0.05, 0.05, base)), wood)
    w, depth, h = rng.uniform(0.11, 0.15), rng.uniform(0.24, 0.3), rng.uniform(0.17, 0.24)
    side = textures.plain(rng, rgb, (28, 56), 0.05)
    ink = (245, 245, 240) if sum(rgb) < 380 else (20, 20, 30)
    cv2.putText(
        side, str(rng.integers(1, 400)), (6, 21), cv2.FONT_HERSHEY_DUPLEX, 0.62, ink, 1, cv2.LINE_AA
    )
    front = textures.plain(rng, rgb, (32, 32), 0.05)
    cv2.rectangle(front, (4, 4), (27, 28), ink, 1)
    cv2.line(front, (12, 8), (20, 8), ink, 2)
    low, high = (-w, -depth, base), (w, depth, base + h)
    model.add(box(low, high, sides="lr", top=False), model.patch(side))
    model.add(box(low, high, sides="fb", top=False, bottom=True), model.patch(front))
    paint = model.patch(textures.plain(rng, textures.times(rgb, 0.9), (16, 16)))
    turn = np.linspace(0, np.pi, 7)
    profile = np.stack([w * np.cos(turn), base + h + 0.75 * w * np.sin(turn)], axis=1)
    strips = [
        polygon([(xa, -depth, za), (xa, depth, za), (xb, depth, zb), (xb, -depth, zb)])
        for (xa, za), (xb, zb) in itertools.pairwise(profile)
    ]
    ends = [
        polygon([(x, -depth, z) for x, z in profile]),
        polygon([(x, depth, z) for x, z in profile[::-1]]),
    ]
    model.add(join(strips), paint)
    model.add(join(ends), paint)
    flag = model.patch(textures.plain(rng, (205, 35, 35), (8, 8)))
    model.add(box((w, -0.05, base + h), (w + 0.02, -0.02, base + h + 0.22), bottom=True), flag)
    model.add(
        box((w, -0.05, base + h + 0.15), (w + 0.02, 0.07, base + h + 0.22), bottom=True), flag
    )
    return (model.surface(),)


def wheelie_bin(rng: np.random.Generator) -> _Surfaces:
    """A wheeled bin with a lid, a number and a sticker."""
    model = Model()
    rgb = textures.hsv(
        rng.choice([110, 150, 215, 30, 0, 55]) + rng.uniform(-10, 10),
        rng.uniform(0.3, 0.8),
        rng.uniform(0.3, 0.65),
    )
    image = textures.plain(rng, rgb, (64, 40), 0.06)
    for y in (8, 52):
        cv2.line(image, (0, y), (40, y), textures.times(rgb, 0.6), 2)
    sticker = _poster(rng, (18, 22))
    image[16:34, 9:31] = sticker
    cv2.putText(
        image, str(rng.integers(1, 400)), (6, 48), cv2.FONT_HERSHEY_PLAIN, 0.9, (245, 245, 245), 1
    )
    body = box((-0.29, -0.29, 0.0), (0.29, 0.29, 0.95))
    low = body.points[:, 2] < 0.1
    body.points[low, :2] *= 0.82
    model.add(body, model.patch(image))
    lid_rgb = rgb if rng.random() < 0.5 else textures.hsv(rng.uniform(0, 360), 0.7, 0.6)
    lid = model.patch(textures.plain(rng, lid_rgb, (24, 24), 0.08))
    model.add(box((-0.32, -0.34, 0.95), (0.32, 0.33, 1.03), bottom=True), lid)
    model.add(box((-0.25, 0.33, 0.9), (0.25, 0.39, 0.97), bottom=True), lid)
    return (model.surface(),)


def hydrant(rng: np.random.Generator) -> _Surfaces:
    """A fire hydrant with a domed cap and two outlets."""
    model = Model()
    rgb = textures.hsv(rng.choice([0, 8, 45, 215]), rng.uniform(0.7, 0.95), rng.uniform(0.65, 0.9))
    body = model.patch(_band(rng, rgb, (48, 48)))
    cap_rgb = textures.hsv(rng.uniform(0, 360), rng.choice([0.0, 0.7]), 0.85)
    cap = model.patch(textures.plain(rng, cap_rgb, (24, 24), 0.08))
    model.add(tube((0, 0, 0), (0, 0, 0.08), 0.18, n=10, cap=True), cap)
    model.add(tube((0, 0, 0.08), (0, 0, 0.6), 0.125, 0.11, n=10), body)
    model.add(tube((0, 0, 0.55), (0, 0, 0.62), 0.155, n=10, cap=True), cap)
    model.add(blob((0, 0, 0.62), (0.125, 0.125, 0.16), n=10, rings=6), body)
    for sign_x in (-1, 1):
        model.add(tube((0, 0, 0.45), (sign_x * 0.22, 0, 0.45), 0.06, n=8, cap=True), cap)
    model.add(tube((0, 0, 0.38), (0, -0.22, 0.38), 0.08, n=8, cap=True), cap)
    return (model.surface(),)
