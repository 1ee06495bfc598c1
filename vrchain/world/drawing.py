"""Drawing on pictures beyond what cv2 has in a call: filled boxes, stars, and words that fit.

Pictures are (h, w, 3) uint8; a box is (x0, y0, x1, y1) in pixels, its last row and column included.
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike

from vrchain.world.shapes import Image
from vrchain.world.textures import Colour

Box = tuple[int, int, int, int]
Share = tuple[float, float, float, float]  # x0, y0, x1, y1 of a picture, in 0..1
_FONT = cv2.FONT_HERSHEY_DUPLEX


def grown(box: Box, rim_px: int) -> Box:
    """A box with a rim around it."""
    x0, y0, x1, y1 = box
    return x0 - rim_px, y0 - rim_px, x1 + rim_px, y1 + rim_px


def fill(image: Image, box: Box, rgb: Colour) -> None:
    """A box in one colour."""
    cv2.rectangle(image, box[:2], box[2:], rgb, -1)


def frame(image: Image, box: Box, rgb: Colour, thick_px: int = 1) -> None:
    """The outline of a box."""
    cv2.rectangle(image, box[:2], box[2:], rgb, thick_px)


def star(
    image: Image, centre: ArrayLike, radius_px: float, n: int, rgb: Colour, inner: float,
    turn_rad: float = 0.0,
) -> None:  # fmt: skip
    """A star of ``n`` points, the first at ``turn_rad``; ``inner``: its waist by its radius."""
    angle = np.arange(2 * n) * np.pi / n + turn_rad
    reach = np.where(np.arange(2 * n) % 2, inner, 1.0) * radius_px
    points = np.asarray(centre) + np.column_stack([np.cos(angle), np.sin(angle)]) * reach[:, None]
    cv2.fillPoly(image, [np.round(points).astype(np.int32)], rgb, cv2.LINE_AA)


def write(image: Image, words: str, font: int, rgb: Colour, share: float) -> None:
    """Words across the middle of a picture, as large as fits; ``share`` of its height at most."""
    h, w = image.shape[:2]
    (wide, high), below = cv2.getTextSize(words, font, 1.0, 2)
    scale = min(0.9 * w / wide, share * h / (high + 0.5 * below))
    thick = max(1, round(1.9 * scale))
    (wide, high), below = cv2.getTextSize(words, font, scale, thick)
    at = ((w - wide) // 2, (h + high) // 2 - round(0.15 * below))
    cv2.putText(image, words, at, font, scale, rgb, thick, cv2.LINE_AA)


def write_within(
    image: Image, words: str, share: Share, rgb: Colour, thickness: float = 2.2
) -> None:
    """Words as large as fits a share of a picture, in its middle; ``thickness`` at full scale."""
    h, w = image.shape[:2]
    x0, y0, x1, y1 = (s * n for s, n in zip(share, (w, h, w, h), strict=True))
    (wide, high), _ = cv2.getTextSize(words, _FONT, 1.0, 2)
    if not wide:
        return
    scale = min((x1 - x0) / wide, (y1 - y0) / high)
    at = (round((x0 + x1 - scale * wide) / 2), round((y0 + y1 + scale * high) / 2))
    thick_px = max(1, round(thickness * scale))
    cv2.putText(image, words, at, _FONT, scale, rgb, thick_px, cv2.LINE_AA)
