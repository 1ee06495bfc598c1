"""Every encoding that cameras send, made RGB."""

from types import SimpleNamespace as Sent

import cv2
import numpy as np
import pytest
from sights import look

from vrchain.errors import ImageError
from vrchain.geometry import Pose
from vrchain.ros.contents import yaw_of
from vrchain.ros.messages import is_jpeg, rgb_of

PICTURE = cv2.GaussianBlur(look(Pose(0, 0)).views[0], (0, 0), 2).astype(np.uint8)
HEIGHT, WIDTH, _ = PICTURE.shape


def image(pixels: np.ndarray, encoding: str, pad: int = 0, big: bool = False) -> Sent:
    rows = np.ascontiguousarray(pixels).reshape(pixels.shape[0], -1)
    data = rows.view(np.uint8)
    if pad:
        data = np.pad(data, ((0, 0), (0, pad)), constant_values=77)
    return Sent(
        encoding=encoding, height=HEIGHT, width=WIDTH, step=data.shape[1], data=data.ravel(),
        is_bigendian=int(big),
    )  # fmt: skip


def bayer(pattern: str) -> np.ndarray:
    raw = np.zeros((HEIGHT, WIDTH), np.uint8)
    for k, colour in enumerate(pattern):
        at = (slice(k // 2, None, 2), slice(k % 2, None, 2))
        raw[at] = PICTURE[(*at, "rgb".index(colour))]
    return raw


def yuv(first: int) -> np.ndarray:
    """Two bytes a pixel, by BT.601; luma at ``first``."""
    matrix = [[65.481, 128.553, 24.966], [-37.797, -74.203, 112.0], [112.0, -93.786, -18.214]]
    y, u, v = np.moveaxis(PICTURE / 255 @ np.transpose(matrix) + [16, 128, 128], -1, 0)
    packed = np.zeros((HEIGHT, WIDTH, 2))
    packed[..., first] = y
    packed[:, 0::2, 1 - first], packed[:, 1::2, 1 - first] = u[:, ::2], v[:, ::2]
    return packed.round().clip(0, 255).astype(np.uint8)


def planes(blue_first: bool) -> np.ndarray:
    """Luma, then half as many rows of colours, one pair for four pixels, by BT.601."""
    packed = yuv(0)
    u, v = packed[::2, 0::2, 1], packed[::2, 1::2, 1]
    pairs = np.stack([u, v] if blue_first else [v, u], axis=-1).reshape(HEIGHT // 2, WIDTH)
    return np.concatenate([packed[..., 0], pairs])


GREY = cv2.cvtColor(PICTURE, cv2.COLOR_RGB2GRAY)
DEEP = PICTURE.astype("<u2") * 257


@pytest.mark.parametrize(
    ("sent", "off"),
    [
        (image(PICTURE, "rgb8"), 0),
        (image(PICTURE, "rgb8", pad=13), 0),
        (image(PICTURE[..., ::-1], "bgr8"), 0),
        (image(PICTURE[..., ::-1], "8UC3"), 0),
        (image(np.dstack([PICTURE, GREY]), "rgba8"), 0),
        (image(np.dstack([PICTURE[..., ::-1], GREY]), "bgra8", pad=4), 0),
        (image(DEEP, "rgb16"), 0),
        (image(DEEP[..., ::-1].astype(">u2"), "bgr16", big=True), 0),
        *((image(bayer(p), f"bayer_{p}8"), 4) for p in ("rggb", "bggr", "gbrg", "grbg")),
        (image(bayer("rggb").astype("<u2") << 8, "bayer_rggb16", pad=6), 4),
        (image(yuv(1), "yuv422"), 4),
        (image(yuv(1), "uyvy", pad=2), 4),
        (image(yuv(0), "yuv422_yuy2"), 4),
        (image(yuv(0), "yuyv"), 4),
        (image(planes(True), "nv12"), 4),
        (image(planes(False), "nv21"), 4),
    ],
    ids=lambda value: getattr(value, "encoding", str(value)),
)
def test_colours(sent: Sent, off: float) -> None:
    shown = rgb_of(sent)
    assert shown.shape == PICTURE.shape and shown.dtype == np.uint8
    assert np.abs(shown.astype(int) - PICTURE).mean() <= off


@pytest.mark.parametrize(
    "sent",
    [
        image(GREY, "mono8", pad=3),
        image(GREY, "8UC1"),
        image(GREY.astype("<u2") * 257, "mono16"),
    ],
    ids=lambda value: value.encoding,
)
def test_grey(sent: Sent) -> None:
    assert np.array_equal(rgb_of(sent), np.dstack([GREY] * 3))


def test_a_last_row_without_its_padding() -> None:
    sent = image(PICTURE, "rgb8", pad=13)
    sent.data = sent.data[:-13]
    assert np.array_equal(rgb_of(sent), PICTURE)


@pytest.mark.parametrize(
    ("sent", "said"),
    [
        (image(GREY, "rgb8"), "if the label is wrong"),
        (image(PICTURE, "32FC1"), "expected an encoding of"),
        (image(PICTURE, ""), "expected an encoding of"),
        (image(GREY, "bayer_rgbw8"), "bayer_rggb"),
        (image(PICTURE[:9], "rgb8"), "if the label is wrong"),
        (Sent(format="jpeg", data=np.zeros(100, np.uint8)), "other bytes"),
        (Sent(format="jpeg", data=np.zeros(0, np.uint8)), "other bytes"),
    ],
)
def test_what_is_no_picture(sent: Sent, said: str) -> None:
    with pytest.raises(ImageError, match=said):
        rgb_of(sent)


def test_a_label_in_place_of_a_wrong_one() -> None:
    assert np.array_equal(rgb_of(image(PICTURE, "bgr8"), "rgb8"), PICTURE)
    assert np.array_equal(rgb_of(image(GREY, "rgb8"), "mono8"), np.dstack([GREY] * 3))


def coded(picture: np.ndarray, ending: str, label: str) -> Sent:
    return Sent(format=label, data=cv2.imencode(ending, picture)[1].ravel())


def test_compressed_pictures() -> None:
    bgr = PICTURE[..., ::-1]
    for label in ("png", "rgb8; png compressed bgr8", "bgr8; png compressed bgr8"):
        assert np.array_equal(rgb_of(coded(bgr, ".png", label)), PICTURE)
    assert np.array_equal(rgb_of(coded(PICTURE, ".png", "rgb8; png compressed rgb8")), PICTURE)
    deep = coded(GREY.astype(np.uint16) * 257, ".png", "mono16; png compressed")
    assert np.array_equal(rgb_of(deep), np.dstack([GREY] * 3))
    raw = coded(bayer("rggb"), ".png", "bayer_rggb8; png compressed")
    assert np.array_equal(rgb_of(raw), rgb_of(image(bayer("rggb"), "bayer_rggb8")))


def test_which_jpeg_is_passed_through() -> None:
    bgr = PICTURE[..., ::-1]
    assert is_jpeg(coded(bgr, ".jpg", "jpeg"))
    assert is_jpeg(coded(bgr, ".jpg", "bgr8; jpeg compressed bgr8"))
    assert not is_jpeg(coded(bgr, ".jpg", "rgb8; jpeg compressed rgb8"))
    assert not is_jpeg(coded(bgr, ".png", "png"))
    assert not is_jpeg(coded(bayer("rggb"), ".jpg", "bayer_rggb8; jpeg compressed"))
    assert is_jpeg(coded(bgr, ".jpg", "bayer_rggb8; jpeg compressed bgr8"))
    assert not is_jpeg(image(PICTURE, "rgb8"))


@pytest.mark.parametrize(("encoding", "width", "height"), [("uyvy", 3, 2), ("nv12", 3, 3)])
def test_a_size_that_an_encoding_cannot_have_is_no_picture(
    encoding: str, width: int, height: int
) -> None:
    sent = Sent(encoding=encoding, height=height, width=width, step=0, is_bigendian=0,
                data=np.zeros(99, np.uint8))  # fmt: skip
    with pytest.raises(ImageError):
        rgb_of(sent)


def test_a_quaternion_beyond_all_bounds_is_none() -> None:
    assert np.isnan(yaw_of(Sent(x=1e200, y=0.0, z=0.0, w=1.0)))
