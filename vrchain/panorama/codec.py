"""Images as bytes: JPEG, WebP and PNG, and what cannot be read."""

import io
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError


@dataclass(frozen=True)
class Codec:
    """How a panorama's views are compressed.

    name: jpeg, webp or png; quality: 0 to 100, for WebP above 100 without loss, for PNG unused.
    """

    name: str
    quality: int = 0

    def __post_init__(self) -> None:
        if self.name not in _QUALITY_FLAGS:
            raise ImageError(f"expected a codec of {', '.join(_QUALITY_FLAGS)}, got {self.name!r}")

    def encode(self, view: NDArray[np.uint8]) -> bytes:
        """The compressed bytes of an RGB image."""
        flag = _QUALITY_FLAGS[self.name]
        flags = [] if flag is None else [flag, self.quality]
        bgr = cv2.cvtColor(view, cv2.COLOR_RGB2BGR)
        return cv2.imencode(f".{self.name}", bgr, flags)[1].tobytes()


_QUALITY_FLAGS = {
    "jpeg": cv2.IMWRITE_JPEG_QUALITY,
    "webp": cv2.IMWRITE_WEBP_QUALITY,
    "png": None,
}
_LFS_POINTER = b"version https://git-lfs"
# By docs/results/dropped.md it keeps 1.02 (0.97-1.07) of the landmarks found without loss,
# in 0.56 of the bytes of quality 90; below, keypoints go. WebP takes 20 times as long for as much.
STORED = Codec("jpeg", 70)


def read_image(path: str | Path) -> NDArray[np.uint8]:
    """An image file as (h, w, 3) uint8 RGB, turned as its EXIF says; ImageError if it is none."""
    return decode_image(read_content(path), str(path))


def read_content(path: str | Path) -> bytes:
    """A file's bytes; ImageError if it cannot be read, or only stands for what Git LFS keeps."""
    try:
        content = Path(path).read_bytes()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise ImageError(f"cannot read {path}: {why}") from error
    if content.startswith(_LFS_POINTER):
        raise ImageError(
            f"{path}: expected a file's content, got a Git LFS pointer to it: run `git lfs pull`"
        )
    return content


def encode_png(image_rgb: NDArray[np.uint8]) -> bytes:
    """PNG bytes of an RGB image."""
    return Codec("png").encode(image_rgb)


def size_of(content: bytes, what: str) -> tuple[int, int]:
    """Width and height of a coded image by its head; ImageError, which names ``what``."""
    from PIL import Image

    try:
        with Image.open(io.BytesIO(content), formats=("JPEG", "PNG", "WEBP")) as image:
            return image.size
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise ImageError(f"{what}: expected an image (JPEG, PNG, ...), got {error}") from error


def decode_image(content: bytes, what: str) -> NDArray[np.uint8]:
    """The RGB image in a file's bytes; ImageError, which names ``what``, if there is none."""
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:  # it is empty, or larger than any that is read
        image = None
    if image is None:
        raise ImageError(f"{what}: expected an image (JPEG, PNG, ...), got something else")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
