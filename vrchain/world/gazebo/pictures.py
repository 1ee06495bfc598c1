"""Pictures of other people, read within bounds."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import SpecError
from vrchain.world.gazebo.files import read_bytes
from vrchain.world.gazebo.limits import MOST_IMAGE_BYTES, MOST_IMAGE_PX, TEXTURE_PX

if TYPE_CHECKING:
    from PIL import Image

_FORMATS = ("PNG", "JPEG", "TGA", "BMP", "GIF", "TIFF", "WEBP", "DDS")


def read_picture(file: Path) -> NDArray[np.uint8]:
    """A picture as (h, w, 4) uint8 RGBA, at most ``TEXTURE_PX`` a side. Raises SpecError."""
    from PIL import Image

    data = read_bytes(file, MOST_IMAGE_BYTES)
    try:
        with Image.open(io.BytesIO(data), formats=_FORMATS) as image:
            if max(image.size) > MOST_IMAGE_PX or min(image.size) < 1:
                raise SpecError(
                    f"{file}: expected a picture of at most {MOST_IMAGE_PX} pixels a side, "
                    f"got {image.size[0]} x {image.size[1]}"
                )
            drawn = _of_eight_bits(image).convert("RGBA")
    except SpecError:
        raise
    except Exception as error:  # decoders raise almost anything
        reason = " ".join(str(error).replace("<_io.BytesIO object", "<it").split())[:120]
        raise SpecError(
            f"{file}: expected a picture ({', '.join(_FORMATS)}), cannot read this: {reason}"
        ) from None
    scale = TEXTURE_PX / max(drawn.size)
    if scale < 1:
        size = (max(1, round(drawn.width * scale)), max(1, round(drawn.height * scale)))
        drawn = drawn.resize(size, Image.Resampling.BOX)
    return np.asarray(drawn)


def _of_eight_bits(image: "Image.Image") -> "Image.Image":
    """Greys of 16 bits, or from 0 to 1, as those of 8 bits; converted, they would be clipped."""
    from PIL import Image

    if image.mode == "F":
        whole = np.round(255 * np.clip(np.nan_to_num(np.asarray(image)), 0, 1))
    elif image.mode.startswith("I"):
        whole = np.clip(np.asarray(image) // 256, 0, 255)
    else:
        return image
    return Image.fromarray(whole.astype(np.uint8))
