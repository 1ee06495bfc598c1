"""Windows, doors and garage doors, drawn on the picture of a wall."""

from dataclasses import dataclass

import cv2
import numpy as np

from vrchain.world import textures
from vrchain.world.buildings.facade_style import PX_PER_M, Style
from vrchain.world.shapes import Image

_Box = tuple[int, int, int, int]


@dataclass(frozen=True)
class Opening:
    """A window, door or garage door; x_m: its middle from the wall's left; z_m: its foot."""

    kind: str  # "window", "door" or "garage"
    x_m: float
    z_m: float
    width_m: float
    height_m: float


def draw(rng: np.random.Generator, image: Image, style: Style, opening: Opening) -> None:
    """Draw an opening on the picture of its wall."""
    height = image.shape[0]
    x0, x1 = ((opening.x_m + s * opening.width_m / 2) * PX_PER_M for s in (-1, 1))
    y0, y1 = height - (opening.z_m + opening.height_m) * PX_PER_M, height - opening.z_m * PX_PER_M
    kinds = {"window": _window, "door": _door, "garage": _garage_door}
    kinds[opening.kind](rng, image, style, (round(x0), round(y0), round(x1), round(y1)))


def _window(rng: np.random.Generator, image: Image, style: Style, box: _Box) -> None:
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0
    trim = style.trim_rgb
    frame = max(2, round(0.09 * PX_PER_M))
    dark = textures.times(style.wall_rgb, 0.35)
    if style.shutters:
        leaf = max(4, w // 3)
        for left in (x0 - frame - leaf, x1 + frame):
            cv2.rectangle(image, (left, y0), (left + leaf, y1), style.shutter_rgb, -1)
            for y in range(y0 + 3, y1 - 1, 4):
                cv2.line(
                    image,
                    (left + 2, y),
                    (left + leaf - 2, y),
                    textures.times(style.shutter_rgb, 0.6),
                    1,
                )
            cv2.rectangle(
                image, (left, y0), (left + leaf, y1), textures.times(style.shutter_rgb, 0.5), 1
            )
    cv2.rectangle(
        image, (x0 - frame - 1, y0 - frame - 1), (x1 + frame + 1, y1 + frame + 1), dark, 1
    )
    cv2.rectangle(image, (x0 - frame, y0 - frame), (x1 + frame, y1 + frame), trim, -1)
    image[max(y0, 0) : y1, max(x0, 0) : x1] = _glass(rng, (h, w), style)[
        max(-y0, 0) :, max(-x0, 0) :
    ][: image.shape[0] - max(y0, 0), : image.shape[1] - max(x0, 0)]
    if style.arched:
        cv2.ellipse(image, (x0 + w // 2, y0), (w // 2 + frame, w // 3), 0, 180, 360, trim, -1)
        cv2.ellipse(
            image, (x0 + w // 2, y0), (w // 2, w // 3 - frame), 0, 180, 360, (70, 85, 105), -1
        )
    across, up = style.panes
    for k in range(1, across):
        x = x0 + k * w // across
        cv2.line(image, (x, y0), (x, y1), trim, 2)
    for k in range(1, up):
        y = y0 + k * h // up
        cv2.line(image, (x0, y), (x1, y), trim, 2)
    sill = y1 + frame
    cv2.rectangle(
        image,
        (x0 - 2 * frame, sill),
        (x1 + 2 * frame, sill + 2),
        textures.times(trim, 1.1),
        -1,
    )
    cv2.line(image, (x0 - 2 * frame, sill + 3), (x1 + 2 * frame, sill + 3), dark, 1)
    if style.lintel:
        cv2.rectangle(
            image,
            (x0 - 2 * frame, y0 - 3 * frame),
            (x1 + 2 * frame, y0 - frame),
            style.plinth_rgb,
            -1,
        )
    if rng.random() < 0.2:  # a flower box
        y = sill + 3
        cv2.rectangle(image, (x0, y), (x1, y + 6), (105, 70, 45), -1)
        for x in range(x0, x1, 3):
            petal = (
                textures.hsv(rng.uniform(-60, 60), 0.8, 0.9)
                if rng.random() < 0.5
                else (60, 120, 50)
            )
            cv2.circle(image, (x, y - int(rng.integers(0, 5))), 2, petal, -1)


def _glass(rng: np.random.Generator, shape: textures.Shape, style: Style) -> Image:
    """Dark glass that mirrors the sky above, with curtains or a blind behind some of it."""
    h, w = shape
    up = np.linspace(1, 0, h, dtype=np.float32)[:, None]
    tilt = np.linspace(-0.3, 0.3, w, dtype=np.float32)[None, :] * np.float32(rng.choice([-1, 1]))
    sky = np.clip(up + tilt + 0.25 * textures.noise(rng, shape, 12), 0, 1)[..., None]
    image = 35 + sky * np.array([85, 110, 135], dtype=np.float32)
    style_of_blind = rng.integers(4)
    if style_of_blind < 2:  # curtains
        fold = 0.75 + 0.25 * np.sin(np.arange(w) * rng.uniform(0.7, 1.4))
        reach = rng.uniform(0.15, 0.35) * w
        x = np.arange(w)
        behind = (x < reach) | (x > w - reach)
        cloth = np.asarray(style.curtain_rgb) * fold[:, None]
        image[:, behind] = 0.35 * image[:, behind] + 0.65 * cloth[behind]
    elif style_of_blind == 2:  # a blind, drawn part of the way
        reach = int(rng.uniform(0.2, 0.8) * h)
        slats = np.where(np.arange(reach) % 4 == 0, 0.6, 0.95)[:, None, None]
        image[:reach] = 0.3 * image[:reach] + 0.7 * np.asarray(style.curtain_rgb) * slats
    image[:3] *= 0.6
    return np.clip(image, 0, 255).astype(np.uint8)


def _door(rng: np.random.Generator, image: Image, style: Style, box: _Box) -> None:
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0
    frame = max(3, round(0.11 * PX_PER_M))
    cv2.rectangle(image, (x0 - frame, y0 - frame), (x1 + frame, y1), style.trim_rgb, -1)
    image[y0:y1, x0:x1] = textures.wood(rng, (h, w), style.door_rgb)
    dark, light = textures.times(style.door_rgb, 0.55), textures.times(style.door_rgb, 1.35)
    across, up = int(rng.integers(1, 3)), int(rng.integers(2, 4))
    glazed = rng.random() < 0.6
    for i in range(across):
        for j in range(up):
            left, top = x0 + 3 + i * (w - 4) // across, y0 + 4 + j * (h - 4) // up
            right, bottom = x0 + (i + 1) * (w - 4) // across, y0 + (j + 1) * (h - 4) // up
            if glazed and j == 0:
                cv2.rectangle(image, (left, top), (right, bottom), (75, 90, 110), -1)
                cv2.line(image, (left, bottom), (right, top), (150, 170, 185), 1, cv2.LINE_AA)
            cv2.rectangle(image, (left, top), (right, bottom), dark, 1)
            cv2.line(image, (left, bottom + 1), (right, bottom + 1), light, 1)
    cv2.circle(image, (x1 - 5, y0 + int(0.55 * h)), 2, (225, 200, 110), -1)
    cv2.rectangle(image, (x0, y1 - 5), (x1, y1), (150, 140, 120), -1)
    plate = (x1 + frame + 4, y0 + int(0.3 * h))
    cv2.rectangle(image, plate, (plate[0] + 26, plate[1] + 14), (235, 235, 225), -1)
    cv2.putText(
        image,
        str(style.number),
        (plate[0] + 2, plate[1] + 11),
        cv2.FONT_HERSHEY_SIMPLEX,
        0.36,
        (25, 25, 25),
        1,
    )


def _garage_door(rng: np.random.Generator, image: Image, style: Style, box: _Box) -> None:
    x0, y0, x1, y1 = box
    frame = max(3, round(0.12 * PX_PER_M))
    base = style.trim_rgb if rng.random() < 0.5 else style.door_rgb
    cv2.rectangle(image, (x0 - frame, y0 - frame), (x1 + frame, y1), style.trim_rgb, -1)
    image[y0:y1, x0:x1] = textures.plain(rng, base, (y1 - y0, x1 - x0))
    rows, cols = int(rng.integers(3, 6)), int(rng.integers(3, 7))
    dark = textures.times(base, 0.6)
    glass_row = int(rng.integers(-2, 2))
    for r in range(rows):
        top, bottom = y0 + r * (y1 - y0) // rows, y0 + (r + 1) * (y1 - y0) // rows
        cv2.line(image, (x0, bottom), (x1, bottom), textures.times(base, 0.4), 1)
        for c in range(cols):
            left, right = x0 + c * (x1 - x0) // cols + 3, x0 + (c + 1) * (x1 - x0) // cols - 3
            if r == glass_row:
                cv2.rectangle(image, (left, top + 4), (right, bottom - 4), (65, 80, 95), -1)
            cv2.rectangle(image, (left, top + 4), (right, bottom - 4), dark, 1)
    cv2.rectangle(image, (x0, y0), (x1, y1), textures.times(base, 0.4), 1)
