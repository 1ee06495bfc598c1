"""Panoramas as others show them: an equirectangular JPEG that says of itself what it is (GPano)."""

import io

import cv2
import numpy as np

from vrchain.panorama.panorama import Panorama

_QUALITY = 95
_XMP = """<x:xmpmeta xmlns:x="adobe:ns:meta/">
<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description rdf:about="" xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" {}/>
</rdf:RDF></x:xmpmeta>"""


def equirectangular_jpeg(panorama: Panorama, heading_deg: float | None = None) -> bytes:
    """A panorama as an equirectangular picture, as a camera that sees all around writes it.

    It is the part of the sphere that every view fills, with the cylinder's pixels a radian; GPano
    says which part, that the camera was upright, and the heading of the picture's middle, clockwise
    from north, if it is known. What no camera saw is black, and no longer masked.
    """
    from PIL import Image

    rig = panorama.rig
    rows, columns = rig.cylinder_shape
    whole_px = 2 * round(rig.px_per_rad * np.pi)  # the full sphere's width
    width_px = whole_px if rig.closed else 2 * (columns // 2)
    highest_rad = np.arctan(rows / 2 / rig.px_per_rad)
    height_px = 2 * int(highest_rad * whole_px / (2 * np.pi))
    height_px -= (whole_px // 2 - height_px) % 2  # else it would not lie in the middle
    rad_per_px = 2 * np.pi / whole_px
    bearing = (width_px / 2 - 0.5 - np.arange(width_px)) * rad_per_px
    elevation = (height_px / 2 - 0.5 - np.arange(height_px)) * rad_per_px
    x_px = np.broadcast_to(rig.column_of_bearing(bearing), (height_px, width_px))
    y_px = np.broadcast_to(rig.row_of_slope(np.tan(elevation))[:, None], x_px.shape)
    maps = x_px.astype(np.float32), y_px.astype(np.float32)
    drawn = cv2.remap(panorama.cylinder, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    told: dict[str, object] = {
        "ProjectionType": "equirectangular",
        "FullPanoWidthPixels": whole_px,
        "FullPanoHeightPixels": whole_px // 2,
        "CroppedAreaImageWidthPixels": width_px,
        "CroppedAreaImageHeightPixels": height_px,
        "CroppedAreaLeftPixels": (whole_px - width_px) // 2,
        "CroppedAreaTopPixels": (whole_px // 2 - height_px) // 2,
        "PosePitchDegrees": 0,
        "PoseRollDegrees": 0,
    }
    if heading_deg is not None:
        told["PoseHeadingDegrees"] = round(heading_deg % 360, 3)
    xmp = _XMP.format(" ".join(f'GPano:{name}="{value}"' for name, value in told.items()))
    held = io.BytesIO()
    Image.fromarray(drawn).save(held, "JPEG", quality=_QUALITY, subsampling=0, xmp=xmp.encode())
    return held.getvalue()
