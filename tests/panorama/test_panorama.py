import io
import json
import struct

import cv2
import numpy as np
import pytest
import worlds
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from vrchain.errors import ImageError, SpecError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.panorama import CameraRig, Codec, Panorama, encode_png, read_image, view_change
from vrchain.panorama import panorama as panorama_module
from vrchain.panorama.codec import STORED
from vrchain.panorama.panorama import pack
from vrchain.seeding import generator
from vrchain.world.render import Renderer

RIGS = [CameraRig(), worlds.SMALL_RIG, CameraRig(3, 40, 30, 120.0), CameraRig(1, 64, 48, 90.0)]
TINY = CameraRig(n_views=3, width_px=24, height_px=16, field_of_view_deg=120.0)


def noise_panorama(rig: CameraRig) -> Panorama:
    shape = (rig.n_views, rig.height_px, rig.width_px, 3)
    return Panorama(rig, generator(0, "noise").integers(0, 256, shape, dtype=np.uint8))


def smooth_panorama(rig: CameraRig) -> Panorama:
    """A picture that JPEG can keep: colour goes with the bearing and the slope."""
    rays = rig.ray_directions()
    return Panorama(rig, (127.5 + 120 * rays).astype(np.uint8))


@pytest.mark.parametrize("rig", RIGS)
def test_columns_and_bearings_are_inverse(rig: CameraRig) -> None:
    rows, columns = rig.cylinder_shape
    columns_px = np.arange(columns)
    bearing_rad = rig.bearing_of_column(columns_px)
    assert np.allclose(rig.column_of_bearing(bearing_rad), columns_px)
    assert np.allclose(rig.row_of_slope(rig.slope_of_row(np.arange(rows))), np.arange(rows))
    assert (np.diff(bearing_rad) < 0).all()  # leftmost is the largest bearing
    assert np.allclose(bearing_rad + bearing_rad[::-1], 0)  # the middle looks ahead
    assert bearing_rad[0] < rig.span_rad / 2
    assert np.isclose(bearing_rad[0] - bearing_rad[-1], rig.span_rad * (1 - 1 / columns))


@pytest.mark.parametrize("rig", RIGS)
def test_rays_project_back_onto_their_pixels(rig: CameraRig) -> None:
    rays = rig.ray_directions()
    assert rays.shape == (rig.n_views, rig.height_px, rig.width_px, 3)
    assert np.allclose(np.linalg.norm(rays, axis=-1), 1, atol=1e-6)
    for view in range(rig.n_views):
        x, y, z = np.moveaxis(rays[view].astype(float), -1, 0)
        x_px, y_px = rig.project(view, np.arctan2(y, x), z / np.hypot(x, y))
        assert np.allclose(x_px, np.arange(rig.width_px)[None, :], atol=1e-3)
        assert np.allclose(y_px, np.arange(rig.height_px)[:, None], atol=1e-3)


@pytest.mark.parametrize("rig", RIGS)
def test_cylinder_pixels_show_their_own_direction(rig: CameraRig) -> None:
    cylinder = smooth_panorama(rig).cylinder.astype(float)
    rows, columns = rig.cylinder_shape
    assert cylinder.shape == (rows, columns, 3)
    bearing = rig.bearing_of_column(np.arange(columns))[None, :]
    slope = rig.slope_of_row(np.arange(rows))[:, None]
    rays = np.stack(np.broadcast_arrays(np.cos(bearing), np.sin(bearing), slope), axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    assert np.abs(cylinder - (127.5 + 120 * rays)).max() < 2.5


@pytest.mark.parametrize("rig", RIGS)
def test_every_cylinder_direction_lies_inside_its_view(rig: CameraRig) -> None:
    columns = rig.cylinder_shape[1]
    bearing = rig.bearing_of_column(np.arange(columns))
    view = rig.view_of_bearing(bearing)
    off_axis = wrap_angle_rad(bearing - rig.azimuths_rad[view])
    assert np.abs(off_axis).max() <= np.pi / rig.n_views
    x_px, y_px = rig.project(view, bearing, np.full(columns, rig.slope_of_row(0)))
    assert x_px.min() > -0.5 and x_px.max() < rig.width_px - 0.5
    assert y_px.min() > -0.5


@pytest.mark.parametrize(
    "bad",
    [
        {"n_views": 0}, {"n_views": 8.0}, {"n_views": True},
        {"n_views": 5},  # 5 x 60 degrees leave gaps
        {"n_views": 32, "width_px": 16, "field_of_view_deg": 120.0},  # not a column for each
        {"n_views": 64, "width_px": 4096, "height_px": 4096},
        {"width_px": 640.5}, {"height_px": 10**9}, {"field_of_view_deg": 180.0},
        {"field_of_view_deg": float("nan")}, {"field_of_view_deg": "60"}, {"camera_height_m": -1.0},
    ],
)  # fmt: skip
def test_impossible_rigs_are_refused(bad: dict) -> None:
    with pytest.raises(SpecError, match="camera rig"):
        CameraRig(**bad)


@pytest.mark.parametrize("shape", [(2, 16, 24, 3), (3, 24, 16, 3), (3, 16, 24)])
def test_views_must_fit_the_rig(shape: tuple[int, ...]) -> None:
    with pytest.raises(ImageError, match="expected uint8 views"):
        Panorama(TINY, np.zeros(shape, dtype=np.uint8))
    with pytest.raises(ImageError, match="float64"):
        Panorama(TINY, np.zeros((3, 16, 24, 3)))


@pytest.mark.parametrize("rig", RIGS)
def test_encoding_keeps_the_picture(rig: CameraRig) -> None:
    panorama = smooth_panorama(rig)
    blob = panorama.encode()
    again = Panorama.decode(blob)
    assert again.rig == rig
    assert np.abs(again.views.astype(int) - panorama.views).mean() < 2
    assert panorama.encode() == blob


@pytest.mark.parametrize("codec", [Codec("png"), Codec("webp", 101)])
def test_codecs_without_loss_keep_every_pixel(codec: Codec) -> None:
    panorama = noise_panorama(TINY)
    assert np.array_equal(Panorama.decode(panorama.encode(codec)).views, panorama.views)


def test_an_unknown_codec_is_refused() -> None:
    with pytest.raises(ImageError, match="jpeg, webp, png, got 'gif'"):
        Codec("gif")


MAGIC = b"VRPANO\x00\x01"


def with_header(header: object) -> bytes:
    table = header if isinstance(header, bytes) else json.dumps(header).encode()
    return MAGIC + struct.pack(">I", len(table)) + table


def with_view_bytes(told: object, views: bytes = b"") -> bytes:
    rig = {"n_views": 1, "width_px": 16, "height_px": 16}
    return with_header({"rig": rig, "view_bytes": told}) + views


DDS = b"DDS " + struct.pack("<I", 124) + bytes(120)  # of a kind that Pillow reads, and broken
HUGE = STORED.encode(np.zeros((4000, 4000, 3), np.uint8))  # of a rig of 16 x 16 pixels


@pytest.mark.parametrize(
    "blob",
    [
        b"", MAGIC, MAGIC + b"\xff\xff\xff\xff", b"\xff\xd8\xff\xe0 a photograph",
        with_header(b"\xff\xfe"), with_header(b"[" * 100_000), with_header([]),
        with_header({"rig": {}, "view_bytes": [1]}), with_header({"rig": [], "view_bytes": []}),
        with_header({"rig": {"lens": 1}, "view_bytes": []}),
        with_header({"rig": {"n_views": 1.0}, "view_bytes": [0]}),
        with_view_bytes(3), with_view_bytes([0]), with_view_bytes([float("inf")]),
        with_view_bytes([float("nan")]), with_view_bytes([2**63]), with_view_bytes([2**80]),
        with_view_bytes([-5], b"12345"), with_view_bytes([5], b"12345"),
        noise_panorama(TINY).encode() + b"x", noise_panorama(TINY).encode()[:-1],
        noise_panorama(TINY).encode().replace(b'"width_px":24', b'"width_px":25'),  # another size
        with_view_bytes([len(HUGE)], HUGE),
        with_view_bytes([len(DDS)], DDS),
    ],
    ids=range(24),
)  # fmt: skip
def test_what_is_no_encoded_panorama_is_refused(blob: bytes) -> None:
    with pytest.raises(ImageError):
        Panorama.decode(blob)


def test_a_view_that_its_metadata_turn_is_refused() -> None:
    """Its head tells the size before it is turned, and views of two sizes cannot be stacked."""
    upright, turned = io.BytesIO(), io.BytesIO()
    exif = Image.Exif()
    exif[274] = 6
    picture = Image.fromarray(np.full((16, 24, 3), 90, np.uint8))
    picture.save(upright, "JPEG")
    picture.save(turned, "JPEG", exif=exif)
    views = [upright.getvalue(), turned.getvalue(), upright.getvalue()]
    with pytest.raises(ImageError, match="another size than its rig says"):
        Panorama.decode(pack(TINY, "jpeg", views, None))


@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=8))
def test_mutated_blobs_decode_or_raise_image_error(changes: list[tuple[int, int]]) -> None:
    blob = bytearray(noise_panorama(TINY).encode())
    for place, value in changes:  # half of them into the header
        limit = 300 if place % 2 else len(blob)
        blob[place % limit] = value
    try:
        assert Panorama.decode(bytes(blob)).views.dtype == np.uint8
    except ImageError as error:
        assert str(error)


@given(st.binary(max_size=200))
def test_random_bytes_are_no_panorama(tail: bytes) -> None:
    for blob in (tail, MAGIC + tail):
        with pytest.raises(ImageError):
            Panorama.decode(blob)


@pytest.mark.parametrize("rig", [TINY, RIGS[3]])
def test_saved_panorama_is_read_back_exactly(tmp_path, rig: CameraRig) -> None:
    panorama = noise_panorama(rig)
    panorama.save(tmp_path)
    again = Panorama.load(tmp_path)
    assert again.rig == rig
    assert np.array_equal(again.views, panorama.views)
    assert np.array_equal(read_image(tmp_path / "cylinder.png"), panorama.cylinder)


def test_loading_names_what_is_wrong(tmp_path) -> None:
    with pytest.raises(ImageError, match=r"no panorama: it holds no panorama\.json"):
        Panorama.load(tmp_path)
    noise_panorama(TINY).save(tmp_path)
    marker, view = tmp_path / "panorama.json", tmp_path / "view_2.png"
    good_view, good_marker = view.read_bytes(), marker.read_text()
    view.write_bytes(encode_png(np.zeros((16, 25, 3), dtype=np.uint8)))
    with pytest.raises(ImageError, match=r"view_2\.png: expected 24 x 16 .* got 25 x 16"):
        Panorama.load(tmp_path)
    view.unlink()
    with pytest.raises(ImageError, match=r"view_2\.png: No such file"):
        Panorama.load(tmp_path)
    view.write_bytes(good_view)
    for wrong in ("", "[]", '{"rig": 3}', '{"rig": {"n_views": 3.0}}', "[" * 100_000):
        marker.write_text(wrong)
        with pytest.raises(ImageError, match=r"panorama\.json: unreadable"):
            Panorama.load(tmp_path)
    marker.write_text(good_marker)
    assert Panorama.load(tmp_path).rig == TINY


@pytest.mark.parametrize(
    ("content", "words"),
    [*((content, r"a\.png: expected an image")
       for content in (b"", b"text, not a picture", b"\x89PNG\r\n\x1a\n broken")),
     (None, "No such file")],
)  # fmt: skip
def test_files_that_are_no_images_are_refused(tmp_path, content: bytes | None, words: str) -> None:
    path = tmp_path / "a.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ImageError, match=words):
        read_image(path)
    with pytest.raises(ImageError, match="directory"):
        read_image(tmp_path)


def test_images_become_rgb_and_colours_keep_their_order(tmp_path) -> None:
    path = tmp_path / "a.png"
    for shape in [(5, 7), (5, 7, 4)]:  # grey, and with transparency
        cv2.imwrite(str(path), np.full(shape, 200, dtype=np.uint8))
        assert np.array_equal(read_image(path), np.full((5, 7, 3), 200))
    image = np.zeros((4, 4, 3), dtype=np.uint8)
    image[0] = (250, 100, 5)
    path.write_bytes(encode_png(image))
    assert np.array_equal(read_image(path), image)


def test_view_change_ignores_turning_and_grows_with_distance() -> None:
    renderer = Renderer(worlds.yard())

    def signature(x_m: float, y_m: float, yaw_rad: float) -> np.ndarray:
        return renderer.render(Pose(x_m, y_m, yaw_rad), worlds.SMALL_RIG).signature()

    here = signature(0, 0, 0)
    assert view_change(here, here) == pytest.approx(0, abs=1e-6)
    turned = [view_change(here, signature(0, 0, yaw)) for yaw in np.linspace(0.03, 6.2, 9)]
    moved = [view_change(here, signature(d, -d, 1.0)) for d in (0.2, 0.4, 0.8, 1.5)]
    assert max(turned) < 0.1
    assert moved == sorted(moved)
    assert moved[-1] > 0.4
    blank, other = np.zeros((2, 16, 180), dtype=np.float32)
    other[3, 5] = 9
    assert view_change(blank, blank) == 0 and view_change(blank, other) == 1


def masked(rig: CameraRig) -> Panorama:
    whole = noise_panorama(rig)
    seen = np.ones(whole.views.shape[:3], dtype=bool)
    seen[0, :, 5:] = False
    return Panorama(rig, whole.views, seen)


def test_a_mask_of_another_size_is_refused_by_its_head(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some kilobytes of black ask for gigabytes."""
    shown = noise_panorama(TINY)
    coded = [encode_png(view) for view in shown.views]
    black = np.zeros((TINY.n_views, 3000, 3000), dtype=bool)
    decoded: list[str] = []
    decode = panorama_module.decode_image
    monkeypatch.setattr(
        panorama_module, "decode_image", lambda c, w: (decoded.append(w), decode(c, w))[1]
    )
    with pytest.raises(ImageError, match="what is seen has another size"):
        Panorama.decode(pack(TINY, "png", coded, black))
    assert set(decoded) == {"a view"}


def test_what_is_seen_goes_with_the_panorama(tmp_path) -> None:
    """Into the ledger's blob and into the folder, bit by bit."""
    panorama = masked(TINY)
    panorama.save(tmp_path, {"heading_deg": 3.0})
    for again in (Panorama.load(tmp_path), Panorama.decode(panorama.encode())):
        assert again.seen is not None and np.array_equal(again.seen, panorama.seen)
    shown = panorama.seen_cylinder
    assert shown is not None and shown.shape == TINY.cylinder_shape
    assert 0 < shown.mean() < 1
    assert noise_panorama(TINY).seen_cylinder is None
    (tmp_path / "seen.png").write_bytes(encode_png(np.zeros((16, 25, 3), dtype=np.uint8)))
    with pytest.raises(ImageError, match=r"seen\.png: what is seen has another size"):
        Panorama.load(tmp_path)
    (tmp_path / "seen.png").unlink()
    with pytest.raises(ImageError, match=r"seen\.png: No such file"):
        Panorama.load(tmp_path)


def test_it_shows_what_a_camera_looked_at() -> None:
    rig = CameraRig(4, 32, 24, 100.0)
    assert all(noise_panorama(rig).shows(bearing) for bearing in np.arange(-10.0, 10.0, 0.5))
    seen = np.ones((4, 24, 32), dtype=bool)
    seen[1] = False  # the camera on the left is missing
    left = Panorama(rig, noise_panorama(rig).views, seen)
    assert not left.shows(np.pi / 2)
    assert all(left.shows(bearing) for bearing in (0.0, np.pi, -np.pi / 2, -np.pi))
    ahead = noise_panorama(CameraRig(1, 32, 24, 100.0))
    assert [ahead.shows(np.radians(deg)) for deg in (0, 45, -45, 55, -55, 180)] == [
        True, True, True, False, False, False,
    ]  # fmt: skip


def test_blobs_with_a_wrong_mask_are_refused() -> None:
    blob = masked(TINY).encode()
    rig = {"n_views": 1, "width_px": 16, "height_px": 16}
    too_long = with_header({"rig": rig, "view_bytes": [1], "seen_bytes": 10**20}) + b"1"
    for wrong in (
        blob[:-1],
        blob + b"x",
        blob.replace(b'"seen_bytes":', b'"seen_byte":-'),
        too_long,
    ):
        with pytest.raises(ImageError):
            Panorama.decode(wrong)
    with pytest.raises(ImageError, match="expected what is seen as bool"):
        Panorama(TINY, noise_panorama(TINY).views, np.ones((1, 2, 3), dtype=bool))


def test_what_is_unseen_is_no_change_of_view() -> None:
    """The hole stays where it is as the robot turns: it must not count as a landmark."""
    rig = CameraRig(8, 80, 60, 60.0)
    whole = noise_panorama(rig)
    seen = np.ones(whole.views.shape[:3], dtype=bool)
    seen[2:7] = False
    one = Panorama(rig, np.where(seen[..., None], whole.views, 0).astype(np.uint8), seen)
    other = Panorama(rig, np.where(seen[..., None], 255 - whole.views, 0).astype(np.uint8), seen)
    assert view_change(one.signature(), one.signature()) == pytest.approx(0, abs=1e-6)
    assert view_change(one.signature(), other.signature()) > 0.5
