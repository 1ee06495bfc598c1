"""Shops: display windows and lettering below, a wall above, awnings and signs before them.

Model frame: the plan's middle at the origin, the front towards -y.
"""

from dataclasses import replace

import cv2
import numpy as np
from numpy.random import Generator

from vrchain.world import textures
from vrchain.world.buildings import facades, roofs
from vrchain.world.buildings.facades import PX_PER_M, Opening
from vrchain.world.buildings.plans import GROUND_FLOOR_M, STOREY_M, ShopPlan
from vrchain.world.buildings.shell import Shell
from vrchain.world.drawing import fill, frame, write
from vrchain.world.model import Surface
from vrchain.world.shapes import Image, box, join, polygon, tube, wall
from vrchain.world.textures import random_hsv

_SIGN_PX_PER_M = 60.0  # finer than walls, so that lettering is read from afar
_SIGN_M = (2.75, 3.4)  # foot and top of the sign over the windows
_PARAPET_M = 0.6
_FONTS = (
    cv2.FONT_HERSHEY_SIMPLEX,
    cv2.FONT_HERSHEY_DUPLEX,
    cv2.FONT_HERSHEY_COMPLEX,
    cv2.FONT_HERSHEY_TRIPLEX,
    cv2.FONT_HERSHEY_SCRIPT_COMPLEX,
)
_GABLES = {"gable_x": "rl", "gable_y": "fb"}


class _Shop(Shell):
    """What the pieces of one shop share while it is built."""

    def __init__(self, plan: ShopPlan, rng: Generator) -> None:
        super().__init__(rng)
        self.plan = plan
        self.style = facades.random_style(rng, int(rng.integers(10)))
        if rng.random() < 0.35:
            rgb, tiles = random_hsv(rng, (0, 360), (0.1, 0.6), (0.5, 0.95)), textures.tiles
            self.style = replace(
                self.style, material=tiles, wall_rgb=rgb, upper=tiles, upper_rgb=rgb
            )
        hue = rng.uniform(0, 360)
        self.paint_rgb = random_hsv(rng, hue, (0.35, 0.85), (0.25, 0.65))
        light = textures.hsv(hue + rng.uniform(120, 240), rng.uniform(0.0, 0.35), 0.96)
        dark_board = rng.random() < 0.65
        self.letters_rgb = light if dark_board else self.paint_rgb
        self.board_rgb = self.paint_rgb if dark_board else light
        self.font = int(_FONTS[int(rng.integers(len(_FONTS)))])
        self.roofing = textures.shingles
        self.roof_rgb = random_hsv(rng, rng.choice([10, 20, 215, 30]), (0.1, 0.5), (0.3, 0.6))
        self.trim = self.model.patch(textures.plain(rng, self.style.trim_rgb))
        self.soffit = self.trim
        self.paint = self.model.patch(textures.plain(rng, self.paint_rgb))

    def sign(self, words: str, width_m: float, height_m: float) -> Image:
        """A lettered board."""
        shape = (round(height_m * _SIGN_PX_PER_M), round(width_m * _SIGN_PX_PER_M))
        image = textures.plain(self.rng, self.board_rgb, shape, 0.03)
        frame(image, (3, 3, shape[1] - 4, shape[0] - 4), self.letters_rgb, 2)
        write(image, words, self.font, self.letters_rgb, 0.75)
        return image


def build(plan: ShopPlan, rng: Generator) -> tuple[Surface, ...]:
    """The shop of a plan, its colours, wares and lettering drawn from ``rng``."""
    shop = _Shop(plan, rng)
    _walls(shop)
    _roof(shop)
    _front_sign(shop)
    if plan.shelter == "canopy":
        _canopy(shop)
    elif plan.shelter == "awning":
        _awning(shop)
    if plan.hanging:
        _hanging_sign(shop)
    if plan.board:
        _roof_board(shop)
    return (shop.model.surface(),)


def _walls(shop: _Shop) -> None:
    plan = shop.plan
    top = plan.top_m + (_PARAPET_M if plan.roof == "flat" else 0.0)
    for side in "frbl":
        slopes = (plan.pitch,) if side in _GABLES.get(plan.roof, "") else ()
        part, width, height = roofs.gable_wall(plan.main.side(side), 0.0, top, slopes)
        image = facades.paint(shop.rng, shop.style, width, height, _windows(shop, side, width))
        if side == "f":
            _shopfront(shop, image)
        if (side, plan.advert_side) in (("r", 1), ("l", -1)):
            _advert(shop, image)
        shop.model.add(part, image)


def _windows(shop: _Shop, side: str, width_m: float) -> list[Opening]:
    """Upper windows everywhere, and behind and beside a door or a window below."""
    plan, rng = shop.plan, shop.rng
    found = []
    n = max(1, int(width_m / rng.uniform(1.9, 2.8)))
    w, h = rng.uniform(0.9, 1.3), rng.uniform(1.2, 1.6)
    for floor, k in np.ndindex(plan.storeys - 1, n):
        foot = GROUND_FLOOR_M + 0.75 + floor * STOREY_M
        found.append(Opening("window", (k + 0.5) * width_m / n, foot, w, h))
    if side == "b":
        found.append(Opening("door", 0.25 * width_m, 0.15, 1.0, 2.05))
        found.append(Opening("window", 0.65 * width_m, 1.0, 1.2, 1.1))
    elif side in "rl" and plan.advert_side != {"r": 1, "l": -1}[side]:
        found.append(Opening("window", 0.7 * width_m, 1.1, 1.0, 1.1))
    return found


def _shopfront(shop: _Shop, image: Image) -> None:
    """Display windows with wares and a glazed door, painted on the foot of the front."""
    plan, rng = shop.plan, shop.rng
    h, w = image.shape[:2]
    edge = round(0.3 * PX_PER_M)
    top = h - round(_SIGN_M[0] * PX_PER_M)
    image[top:, edge : w - edge] = textures.plain(rng, shop.paint_rgb, (h - top, w - 2 * edge))
    door_w = round(1.15 * PX_PER_M)
    door_x = edge + round(plan.door * (w - 2 * edge - door_w))
    stall = h - round(rng.uniform(0.35, 0.7) * PX_PER_M)  # the low wall under the windows
    if rng.random() < 0.5:
        rgb = textures.times(shop.paint_rgb, 0.7)
        for x0, x1 in ((edge, door_x), (door_x + door_w, w - edge)):
            if x1 > x0 + 8:
                image[stall:, x0:x1] = textures.tiles(rng, (h - stall, x1 - x0), rgb, PX_PER_M)
    left, right = door_x - edge, w - edge - door_x - door_w
    for x0, room in ((edge, left), (door_x + door_w, right)):
        n = round(plan.bays * room / max(1, left + right))
        for k in range(n):
            a, b = x0 + k * room // n + 4, x0 + (k + 1) * room // n - 4
            if b - a > 12:
                _display(shop, image[top + 8 : stall, a:b])
    _glass_door(shop, image[top + 8 : h - 3, door_x + 3 : door_x + door_w - 3])


def _display(shop: _Shop, pane: Image) -> None:
    """A lit room behind glass: shelves of wares, lettering on the glass, the sky mirrored."""
    rng = shop.rng
    h, w = pane.shape[:2]
    back = random_hsv(rng, (20, 60), (0.1, 0.5), (0.3, 0.65))
    pane[:] = textures.plain(rng, back, (h, w), 0.05)
    hue, shelves = rng.uniform(0, 360), int(rng.integers(2, 4))
    for row in range(1, shelves + 1):
        foot = row * h // shelves - 2
        x = 2
        while x < w - 5:
            wide, high = int(rng.integers(3, 13)), int(rng.uniform(0.3, 0.8) * h / shelves)
            colour = random_hsv(rng, hue + rng.normal(0, 50), (0.2, 0.9), (0.4, 1.0))
            if rng.random() < 0.6:
                fill(pane, (x, foot - high, x + wide, foot), colour)
            else:
                r = max(2, wide // 2)
                cv2.circle(pane, (x + r, foot - r), r, colour, -1, cv2.LINE_AA)
            x += wide + int(rng.integers(1, 6))
        cv2.line(pane, (0, foot + 1), (w, foot + 1), textures.times(back, 0.5), 2)
    if rng.random() < 0.5:
        word = str(rng.choice(shop.plan.wares))
        write(pane[h // 12 : h // 3], word, shop.font, (250, 248, 235), 0.6)
    glare = np.clip(textures.noise(rng, (h, w), 30), 0, 1.5)[..., None] * 14
    slant = (np.add.outer(np.arange(h), np.arange(w)) % max(40, w)) < 9
    pane[:] = np.clip(pane + glare + 22 * slant[..., None], 0, 255).astype(np.uint8)
    frame(pane, (0, 0, w - 1, h - 1), textures.times(shop.paint_rgb, 0.5), 2)


def _glass_door(shop: _Shop, leaf: Image) -> None:
    """A door with one pane and a card in it."""
    rng = shop.rng
    h, w = leaf.shape[:2]
    leaf[:] = textures.wood(rng, (h, w), shop.style.door_rgb)
    top, foot = round(0.18 * h), round(rng.choice([0.6, 0.85]) * h)
    fill(leaf, (5, 4, w - 6, top - 4), (120, 145, 165))
    fill(leaf, (5, top, w - 6, foot), (70, 85, 100))
    cv2.line(leaf, (5, foot), (w - 6, top + h // 6), (110, 130, 150), 2, cv2.LINE_AA)
    card = leaf[top + h // 6 : top + h // 6 + 11, w // 5 : w - w // 5]
    card[:] = (245, 243, 232)
    word = str(rng.choice(["OPEN", "PUSH", "HELLO"]))
    write(card, word, cv2.FONT_HERSHEY_SIMPLEX, (160, 30, 30), 0.7)
    cv2.circle(leaf, (w - 9, round(0.58 * h)), 2, (225, 205, 130), -1)


def _advert(shop: _Shop, image: Image) -> None:
    """An old advertisement painted on a side wall, the wall showing through."""
    rng, plan = shop.rng, shop.plan
    h, w = image.shape[:2]
    y0, y1 = h - round(2.9 * PX_PER_M), h - round(0.9 * PX_PER_M)
    x0, x1 = round(0.12 * w), round(0.88 * w)
    painted = image.copy()
    panel = painted[y0:y1, x0:x1]
    panel[:] = textures.plain(rng, shop.board_rgb, panel.shape[:2], 0.04)
    frame(panel, (4, 4, panel.shape[1] - 5, panel.shape[0] - 5), shop.letters_rgb, 2)
    inner = panel[8:-8, 8:-8]
    half = inner.shape[0] // 2
    write(inner[:half], plan.name, shop.font, shop.letters_rgb, 0.65)
    ware = str(rng.choice(plan.wares))
    write(inner[half : 2 * half], ware, shop.font, shop.letters_rgb, 0.65)
    worn = np.clip(0.75 + 0.25 * textures.fractal(rng, (h, w), 20, 3), 0.3, 1.0)[..., None]
    image[:] = (worn * painted + (1 - worn) * image).astype(np.uint8)


def _roof(shop: _Shop) -> None:
    plan, rng, r = shop.plan, shop.rng, shop.plan.main
    if plan.roof != "flat":
        shop.cover(roofs.roof(plan.roof, r, plan.top_m, (plan.pitch,), 0.3))
        return
    top = plan.top_m + _PARAPET_M
    x0, y0, x1, y1 = r.grown(0.1)
    shop.flat_roof((x0, y0, top - 0.22), (x1, y1, top))
    raised = rng.choice(["none", "step", "gable"])  # the middle of the front, over the parapet
    half, high = r.width_m * rng.uniform(0.15, 0.3), rng.uniform(0.5, 0.9)
    if raised == "step":
        shop.model.add(box((-half, y0, top), (half, r.y0 + 0.15, top + high)), shop.paint)
    elif raised == "gable":
        front = [(-half, y0, top), (half, y0, top), (0, y0, top + high)]
        back = [(x, r.y0 + 0.15, z) for x, _, z in front]
        edges = [polygon([front[i], back[i], back[j], front[j]]) for i, j in ((1, 2), (2, 0))]
        uv = [(0, 0), (1, 0), (0.5, 1)]
        ends = [polygon(front, uv), polygon([back[k] for k in (1, 0, 2)], uv)]
        shop.model.add(join([*ends, *edges]), shop.paint)
    if rng.random() < 0.5:  # an air conditioner
        x, y = rng.uniform(r.x0 + 1, r.x1 - 2), rng.uniform(-0.5, r.y1 - 1.6)
        grille = textures.metal_sheet(rng, (24, 32), (175.0, 178.0, 180.0), 30.0)
        shop.model.add(box((x, y, top), (x + 1.1, y + 0.9, top + 0.8)), grille)


def _front_sign(shop: _Shop) -> None:
    """The board over the display windows: the name and the trade."""
    plan, r = shop.plan, shop.plan.main
    words = f"{plan.name} {plan.trade}" if r.width_m > 8.5 else plan.name
    low, high = (r.x0 + 0.25, r.y0 - 0.12, _SIGN_M[0]), (r.x1 - 0.25, r.y0, _SIGN_M[1])
    board = shop.sign(words, high[0] - low[0], high[2] - low[2])
    shop.model.add(box(low, high, sides="f", top=False), board)
    shop.model.add(box(low, high, sides="lr", bottom=True), shop.paint)


def _canopy(shop: _Shop) -> None:
    """A slab over the pavement of the forecourt."""
    r, z = shop.plan.main, _SIGN_M[0] - 0.05
    low, high = (r.x0 + 0.3, r.y0 - shop.rng.uniform(0.9, 1.4), z - 0.16), (r.x1 - 0.3, r.y0, z)
    shop.plain(box(low, high, sides="flr", bottom=True))


def _awning(shop: _Shop) -> None:
    """A striped cloth on arms over the pavement of the forecourt."""
    rng, r, z = shop.rng, shop.plan.main, _SIGN_M[0] - 0.05
    x0, x1 = r.x0 + 0.3, r.x1 - 0.3
    out, fall = rng.uniform(1.0, 1.5), rng.uniform(0.35, 0.6)
    cloth = textures.plain(rng, (244.0, 240.0, 228.0), (40, round((x1 - x0) * 20)), 0.03)
    every = int(rng.integers(7, 16))
    for column in range(0, cloth.shape[1], 2 * every):
        stripe = textures.plain(rng, shop.paint_rgb, (40, every), 0.03)
        cloth[:, column : column + every] = stripe[:, : cloth.shape[1] - column]
    patch = shop.model.patch(cloth)
    low, edge = z - fall, r.y0 - out
    slope = np.array([(x0, edge, low), (x1, edge, low), (x1, r.y0, z), (x0, r.y0, z)])
    shop.model.add(polygon(slope), patch)
    shop.model.add(polygon(slope[[1, 0, 3, 2]] - (0, 0, 0.03)), patch, 0.6)
    shop.model.add(box((x0, edge - 0.02, low - 0.25), (x1, edge, low), bottom=True), patch)
    for x in (x0 + 0.1, x1 - 0.1):
        shop.plain(tube((x, edge, low), (x, r.y0, z - 0.5), 0.025, n=5))


def _hanging_sign(shop: _Shop) -> None:
    """A board that stands out from the wall, read by those who come along the street."""
    plan, rng, r = shop.plan, shop.rng, shop.plan.main
    side = -1 if plan.door > 0.5 else 1
    x, w, h = side * (r.width_m / 2 - 0.35), 0.95, rng.uniform(0.6, 0.9)
    z = max(_SIGN_M[1], plan.top_m - 1.0) if plan.storeys > 1 else _SIGN_M[1] - 0.1
    z = min(z, plan.top_m - 0.2)
    y0, y1 = r.y0 - 0.25 - w, r.y0 - 0.25
    board = shop.model.patch(shop.sign(plan.trade, w, h))
    shop.model.add(wall((x + 0.05, y0), (x + 0.05, y1), z - h, z), board)
    shop.model.add(wall((x - 0.05, y1), (x - 0.05, y0), z - h, z), board)
    rim = box((x - 0.05, y0, z - h), (x + 0.05, y1, z), sides="fb", bottom=True)
    shop.model.add(rim, shop.paint)
    shop.plain(tube((x, r.y0, z + 0.06), (x, y0, z + 0.06), 0.03, n=5))


def _roof_board(shop: _Shop) -> None:
    """The trade in large letters on posts upon the roof."""
    plan, rng, r = shop.plan, shop.rng, shop.plan.main
    top = plan.top_m + _PARAPET_M
    w, h = min(r.width_m - 1.0, 0.75 * len(plan.trade)), rng.uniform(0.9, 1.2)
    y, z = r.y0 + 0.9, top + 0.95
    low, high = (-w / 2, y, z), (w / 2, y + 0.1, z + h)
    shop.model.add(box(low, high, sides="f", top=False), shop.sign(plan.trade, w, h))
    shop.model.add(box(low, high, sides="blr", bottom=True), shop.paint)
    for x in (-w / 3, w / 3):
        shop.plain(tube((x, y + 0.06, top), (x, y + 0.06, z), 0.05, n=6))
