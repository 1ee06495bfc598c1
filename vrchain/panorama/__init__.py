"""What a robot sees around it: the ring of cameras, the panorama, and how both are stored."""

from vrchain.panorama.codec import Codec, encode_png, read_image
from vrchain.panorama.panorama import MARKER, Panorama, view_change
from vrchain.panorama.rig import CameraRig
from vrchain.panorama.sources import import_panorama

__all__ = [
    "MARKER", "CameraRig", "Codec", "Panorama", "encode_png", "import_panorama", "read_image",
    "view_change",
]  # fmt: skip
