"""Messages of ROS 1 and 2 opened, and images made RGB; live messages have the same fields."""

import struct
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import BagError, ImageError
from vrchain.ros.formats import Message

ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseStamped"
INFO = "sensor_msgs/msg/CameraInfo"
IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
SCAN = "sensor_msgs/msg/LaserScan"
TF = "tf2_msgs/msg/TFMessage"
TWIST = "geometry_msgs/msg/Twist"
STAMPED = "geometry_msgs/msg/TwistStamped"

_CHANNELS = {"mono": 1, "8UC1": 1, "rgb": 3, "bgr": 3, "8UC3": 3, "rgba": 4, "bgra": 4}
_TO_RGB = {
    "mono": cv2.COLOR_GRAY2RGB,
    "8UC1": cv2.COLOR_GRAY2RGB,
    "bgr": cv2.COLOR_BGR2RGB,
    "8UC3": cv2.COLOR_BGR2RGB,  # as cv_bridge has it
    "rgba": cv2.COLOR_RGBA2RGB,
    "bgra": cv2.COLOR_BGRA2RGB,
    "uyvy": cv2.COLOR_YUV2RGB_UYVY,
    "yuv422": cv2.COLOR_YUV2RGB_UYVY,
    "yuyv": cv2.COLOR_YUV2RGB_YUYV,
    "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUYV,
    "nv12": cv2.COLOR_YUV2RGB_NV12,
    "nv21": cv2.COLOR_YUV2RGB_NV21,
}
_PLANES = ("nv12", "nv21")  # half a row of colours a row


@cache
def typestore(ros1: bool) -> Any:
    """The standard message types of ROS 1 (Noetic) or ROS 2 (Humble)."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    if TF not in store.types:
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))
    return store


def opened(message: Message) -> Any:
    """The message's fields. BagError if it is broken."""
    store = typestore(message.ros1)
    read = store.deserialize_ros1 if message.ros1 else store.deserialize_cdr
    try:
        return read(message.data, message.type)
    except Exception as error:  # generated code: whatever broken bytes lead to
        raise BagError(f"{message.topic}: a message is broken ({error})") from error


def stamp_ns(message: Message) -> int:
    """The time in the header that a message begins with, without opening it; 0: none."""
    try:
        if message.ros1:
            seconds, rest = struct.unpack_from("<II", message.data, 4)
        else:
            order = "<" if message.data[1] & 1 else ">"
            seconds, rest = struct.unpack_from(f"{order}iI", message.data, 4)
    except (struct.error, IndexError):
        return 0
    return seconds * 1_000_000_000 + rest


def is_jpeg(image: Any) -> bool:
    """Whether a message holds JPEG bytes with colours, and these in JPEG's own order."""
    coded = not hasattr(image, "encoding") and bytes(image.data[:2]) == b"\xff\xd8"
    return coded and not _exchanged(image.format) and not _is_mosaic(image.format)


def rgb_of(image: Any, label: str | None = None) -> NDArray[np.uint8]:
    """An Image's or CompressedImage's picture, (h, w, 3) uint8 RGB. ImageError.

    label: the encoding, in place of the one that the message tells.
    """
    try:
        return _rgb_of(image, label)
    except cv2.error as error:  # a size that its encoding cannot have, or beyond all bounds
        raise ImageError(f"expected a picture, got what OpenCV refuses: {error.err}") from error


def _rgb_of(image: Any, label: str | None) -> NDArray[np.uint8]:
    if hasattr(image, "encoding"):
        return _plain(image, label or image.encoding)
    picture = None
    if len(image.data):
        coded = np.frombuffer(image.data, dtype=np.uint8)
        picture = cv2.imdecode(coded, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if picture is None:
        raise ImageError(f"expected a compressed image ({image.format!r}), got other bytes")
    bgr = _eight_bits(picture)
    if _is_mosaic(image.format):
        return _bayer(np.ascontiguousarray(bgr[..., 0]), image.format.partition(";")[0])
    exchanged = label.startswith("bgr") if label else _exchanged(image.format)
    return bgr if exchanged else np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def _exchanged(label: str) -> bool:
    """Whether red and blue were exchanged as it was coded, as image_transport's subscriber has it.

    "rgb8; jpeg compressed bgr8": no; "rgb8; jpeg compressed rgb8": yes; "jpeg": not told, no.
    """
    encoding, told, coded = label.partition(";")
    return bool(told) and encoding.startswith(("rgb", "bgr")) and "compressed bgr" not in coded


def _is_mosaic(label: str) -> bool:
    """Whether each pixel has one colour of a Bayer pattern."""
    return label.startswith("bayer") and "compressed bgr" not in label


def _plain(image: Any, label: str) -> NDArray[np.uint8]:
    name = label.removesuffix("16").removesuffix("8") if not label.startswith("8U") else label
    width, height, wide = image.width, image.height, 2 if label.endswith("16") else 1
    bayer = name.startswith("bayer_")
    if not (bayer or name in _CHANNELS or name in _TO_RGB):
        known = ", ".join([*_CHANNELS, "bayer_rggb", *list(_TO_RGB)[6:]])
        raise ImageError(f"expected an encoding of {known} (8 or 16), got {label!r}")
    channels = 1 if bayer or name in _PLANES else _CHANNELS.get(name, 2)
    rows = height * 3 // 2 if name in _PLANES else height
    used = width * channels * wide
    step = image.step if image.step and rows > 1 else used
    if not (width and height) or step < used or len(image.data) < step * (rows - 1) + used:
        raise ImageError(
            f"encoding {label!r} of {width} x {height} pixels takes {used * rows} bytes, got "
            f"{len(image.data)} in rows of {step}: if the label is wrong, give --rig an encoding"
        )
    data = np.frombuffer(image.data, dtype=np.uint8)
    data = np.pad(data, (0, max(0, step * rows - len(data))))[: step * rows]
    pixels = np.ascontiguousarray(data.reshape(rows, step)[:, :used])
    if wide == 2:
        pixels = _eight_bits(pixels.view(">u2" if image.is_bigendian else "<u2"))
    if bayer:
        return _bayer(pixels, name)
    picture = pixels.reshape(rows, width, channels) if channels > 1 else pixels
    code = _TO_RGB.get(name)
    return np.asarray(picture if code is None else cv2.cvtColor(picture, code), dtype=np.uint8)


def _eight_bits(pixels: NDArray) -> NDArray[np.uint8]:
    return pixels if pixels.dtype == np.uint8 else (pixels >> 8).astype(np.uint8)


def _bayer(pixels: NDArray[np.uint8], label: str) -> NDArray[np.uint8]:
    pattern = label.removeprefix("bayer_").removesuffix("16").removesuffix("8").upper()
    code = getattr(cv2, f"COLOR_Bayer{pattern}2RGB", None)
    if code is None:
        raise ImageError(f"expected bayer_rggb, _bggr, _gbrg or _grbg, got {label!r}")
    return np.asarray(cv2.cvtColor(pixels, code), dtype=np.uint8)
