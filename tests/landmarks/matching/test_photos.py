import os
from collections.abc import Callable
from functools import cache
from itertools import combinations, product
from pathlib import Path

import cv2
import numpy as np
import pytest
import sights
import worlds
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import CommonLandmark
from vrchain.landmarks.matching.photos import landmarks_of_files, photo_landmarks
from vrchain.panorama import CameraRig, Panorama, encode_png
from vrchain.panorama.sources import Source, import_panorama
from vrchain.paths import ROOT
from vrchain.seeding import generator
from vrchain.world.model import Scene

Image = NDArray[np.uint8]
CAMERA = CameraRig(n_views=1, width_px=400, height_px=300)
HOUSE_M = ((9.0, 0.0), (4.0, 4.0, 3.0))


def texture(name: str) -> Image:
    """Squares, each with smaller ones in it."""
    return np.maximum(worlds.blotches(name, 256, 16), worlds.blotches(name + " fine", 256, 64) // 2)


@cache
def street(name: str) -> Scene:
    """One house ahead of the origin, a grey wall behind it."""
    house = worlds.box("house", *HOUSE_M, texture(name), yaw_rad=0.3)
    wall = worlds.box("wall", (17, 0), (1, 30, 5), worlds.plain((120, 120, 120)))
    return worlds.world(house, wall)


@cache
def photo(pose: Pose, name: str = "house") -> Image:
    return sights.look(pose, CAMERA, street(name)).views[0]


HERE, THERE = Pose(0, 0, 0.05), Pose(0.5, 2.0, -0.2)


def house_px(pose: Pose) -> tuple[float, float, float, float]:
    """The house's bounds in the photo taken from a pose."""
    corners = np.concatenate([s.vertices_m for s in street("house").objects[1].surfaces])
    bearing, slope = sights.directions(pose, corners.astype(float))
    x_px, y_px = CAMERA.project(0, bearing, slope)
    return x_px.min(), y_px.min(), x_px.max(), y_px.max()


def check_claims(claims: tuple[CommonLandmark, ...], *images: Image) -> None:
    """Scores in order, boxes in their pictures, and nothing told about angles or ranges."""
    assert [c.score for c in claims] == sorted((c.score for c in claims), reverse=True)
    for claim in claims:
        assert 0 < claim.score <= 1 and claim.ranges is None
        assert len(claim.support_a) == len(claim.support_b) >= 8
        for region, image in zip((claim.a, claim.b), images, strict=True):
            x0, y0, x1, y1 = region.box_px
            assert 0 <= x0 < x1 <= image.shape[1] and 0 <= y0 < y1 <= image.shape[0]
            assert region.bearing_rad is None and region.angular_size_rad is None


@pytest.mark.parametrize("times", [1, 4])
def test_a_thing_photographed_twice_is_claimed_where_it_stands(times: int) -> None:
    """Also in a larger copy, whose regions are in its own pixels."""
    second = np.kron(photo(THERE), np.ones((times, times, 1), dtype=np.uint8))
    claims = photo_landmarks(photo(HERE), second)
    check_claims(claims, photo(HERE), second)
    assert claims
    for claim in claims:
        for pose, region, px in ((HERE, claim.a, 1), (THERE, claim.b, times)):
            low_x, low_y, high_x, high_y = house_px(pose)
            box = np.array(region.box_px) / px
            x, y = box[::2].mean(), box[1::2].mean()
            assert low_x - 5 < x < high_x + 5 and low_y - 5 < y < high_y + 5
            assert box[0] > low_x - 25 and box[2] < high_x + 25


def test_a_photo_has_itself_in_common() -> None:
    claims = photo_landmarks(photo(HERE), photo(HERE))
    check_claims(claims, photo(HERE), photo(HERE))
    assert claims and all(c.a == c.b for c in claims)


def test_unrelated_photos_and_noise_have_nothing_in_common() -> None:
    poses = [HERE, THERE, Pose(0, -2, 0.2)]
    for a, b in product(poses, poses):
        assert photo_landmarks(photo(a), photo(b, "another house")) == ()
    for seed in range(3):
        noise, other = (
            generator(seed, name).integers(0, 256, (300, 400, 3), dtype=np.uint8)
            for name in ("noise", "other")
        )
        assert photo_landmarks(noise, other) == photo_landmarks(noise, photo(HERE)) == ()


@pytest.mark.parametrize("shape", [(16, 16), (16, 3000), (3000, 16), (17, 40)])
def test_small_and_narrow_pictures_are_borne(shape: tuple[int, int]) -> None:
    image = generator(0, "narrow").integers(0, 256, (*shape, 3), dtype=np.uint8)
    check_claims(photo_landmarks(image, image), image, image)
    check_claims(photo_landmarks(image, photo(HERE)), image, photo(HERE))


# --- files ---


def saved(path: Path, image: Image) -> Path:
    path.write_bytes(encode_png(image))
    return path


def test_files_and_arrays_agree(tmp_path: Path) -> None:
    a, b = saved(tmp_path / "a.png", photo(HERE)), saved(tmp_path / "b.png", photo(THERE))
    found = landmarks_of_files(a, str(b))
    assert found.rig is None
    assert np.array_equal(found.a_rgb, photo(HERE)) and np.array_equal(found.b_rgb, photo(THERE))
    claims = photo_landmarks(photo(HERE), photo(THERE))
    assert [(c.score, c.a, c.b) for c in found.claims] == [(c.score, c.a, c.b) for c in claims]


def test_grey_pictures_and_pictures_with_alpha_are_pictures(tmp_path: Path) -> None:
    a = saved(tmp_path / "a.png", photo(HERE))
    bgr = cv2.cvtColor(photo(THERE), cv2.COLOR_RGB2BGR)
    grey = cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY)
    images = {
        "grey.png": grey, "alpha.png": np.dstack([bgr, np.full(grey.shape, 255, np.uint8)]),
        "deep.png": bgr.astype(np.uint16) * 257,
        **{f"b{ending}": bgr for ending in (".jpg", ".bmp", ".webp", ".tiff")},
    }  # fmt: skip
    for name, image in images.items():
        (tmp_path / name).write_bytes(cv2.imencode(Path(name).suffix, image)[1].tobytes())
        assert landmarks_of_files(a, tmp_path / name).claims


def tiny() -> Image:
    return generator(0, "tiny").integers(0, 256, (4, 5, 3), dtype=np.uint8)


UNUSABLE: dict[str, Callable[[], bytes]] = {
    "blank": lambda: encode_png(np.full((200, 300, 3), 77, np.uint8)),
    "tiny": lambda: encode_png(tiny()),
    "pixel": lambda: encode_png(tiny()[:1, :1]),
    "line": lambda: encode_png(np.repeat(tiny()[:1], 2000, axis=1)),
    "text": lambda: b"no picture at all\n",
    "empty": lambda: b"",
    "header": lambda: encode_png(photo(HERE))[:20],
    "marks": lambda: b"\xff\xd8\xff\xd9",  # a JPEG's begin and end
    "zeros": lambda: bytes(5000),
}


@pytest.mark.parametrize("second", [False, True])
@pytest.mark.parametrize("kind", [*UNUSABLE, "missing", "folder", "link"])
def test_what_is_no_usable_picture_is_refused_by_name(
    kind: str, second: bool, tmp_path: Path
) -> None:
    good, bad = saved(tmp_path / "good.png", photo(HERE)), tmp_path / f"{kind}.png"
    if kind in UNUSABLE:
        bad.write_bytes(UNUSABLE[kind]())
    elif kind == "folder":
        bad.mkdir()
    elif kind == "link":
        bad.symlink_to(tmp_path / "nowhere")
    with pytest.raises(ImageError) as error:
        landmarks_of_files(*((good, bad) if second else (bad, good)))
    assert str(bad) in str(error.value)
    assert "\n" not in str(error.value) and len(str(error.value)) < 300 + len(str(bad))


@pytest.mark.parametrize("ending", ["png", "jpg"])
def test_a_picture_cut_short_is_refused_by_name_or_read_as_far_as_it_goes(
    ending: str, tmp_path: Path
) -> None:
    good, cut = saved(tmp_path / "good.png", photo(HERE)), tmp_path / f"cut.{ending}"
    whole = cv2.imencode(f".{ending}", cv2.cvtColor(photo(THERE), cv2.COLOR_RGB2BGR))[1].tobytes()
    for share in (0.01, 0.1, 0.5, 0.9):
        cut.write_bytes(whole[: int(share * len(whole))])
        try:
            check_claims(landmarks_of_files(good, cut).claims, photo(HERE), photo(THERE))
        except ImageError as error:
            assert str(cut) in str(error)


def test_arrays_are_refused_by_their_place() -> None:
    with pytest.raises(ImageError, match="the first picture"):
        photo_landmarks(np.zeros((100, 100, 3), np.uint8), photo(HERE))
    with pytest.raises(ImageError, match="the second picture is too small"):
        photo_landmarks(photo(HERE), photo(HERE)[:8])


def test_two_panoramas_are_compared_as_such(tmp_path: Path) -> None:
    poses = Pose(0, 0, 0.3), Pose(3, 1, -2.0)
    for name, pose in zip("ab", poses, strict=True):
        (tmp_path / name).mkdir()
        sights.look(pose).save(tmp_path / name)
    found = landmarks_of_files(tmp_path / "a", tmp_path / "b", "sift")
    assert found.rig == sights.RIG
    assert np.array_equal(found.a_rgb, sights.look(poses[0]).cylinder)
    assert len(found.claims) > 10 and all(c.a.bearing_rad is not None for c in found.claims)


def test_a_photo_beside_a_panorama_names_the_view(tmp_path: Path) -> None:
    """The house is behind the robot; some of its other views are blank, which is no matter."""
    rig = CameraRig(n_views=8, width_px=400, height_px=300)
    seen = sights.look(Pose(0.5, 2.0, np.pi - 0.2), rig, street("house"))
    # what is not the house is one colour in the views that look away from it
    blanked = seen.views.copy()
    blanked[:2] = 90
    (tmp_path / "pano").mkdir()
    Panorama(rig, blanked).save(tmp_path / "pano")
    picture = saved(tmp_path / "a.png", photo(HERE))
    for one_way in (True, False):
        files = (picture, tmp_path / "pano") if one_way else (tmp_path / "pano", picture)
        found = landmarks_of_files(*files)
        views = [(c.b.view, c.a.view) if one_way else (c.a.view, c.b.view) for c in found.claims]
        assert views and set(views) == {(4, 0)}
        assert np.array_equal(found.b_rgb if one_way else found.a_rgb, seen.views[4])


def test_a_blank_and_a_damaged_panorama_are_refused_by_name(tmp_path: Path) -> None:
    views = sights.look(Pose(0, 0), worlds.SMALL_RIG).views
    for name, shown in (("blank", np.full_like(views, 9)), ("pano", views)):
        (tmp_path / name).mkdir()
        Panorama(worlds.SMALL_RIG, shown).save(tmp_path / name)
    (tmp_path / "pano" / "view_3.png").write_bytes(b"gone")
    picture, blank = saved(tmp_path / "a.png", photo(HERE)), tmp_path / "blank"
    for files in ((blank, picture), (blank, blank)):
        with pytest.raises(ImageError, match=str(blank)):
            landmarks_of_files(*files)
    with pytest.raises(ImageError, match=r"view_3\.png"):
        landmarks_of_files(tmp_path / "pano", tmp_path / "pano")


# --- real photographs ---

PHOTOS = Path(os.environ.get("VRCHAIN_PHOTOS") or ROOT.parent / "shared" / "photos")
needs_photos = pytest.mark.skipif(
    not (PHOTOS / "sacre_coeur").is_dir(),
    reason=f"no real photographs at {PHOTOS}: set VRCHAIN_PHOTOS to a folder of them",
)
SACRE_COEUR = sorted((PHOTOS / "sacre_coeur").glob("*.jpg"))
BERLIN = sorted((PHOTOS / "berlin").glob("*.jpg"))


@needs_photos
def test_real_photos_of_one_building_share_it_and_others_do_not() -> None:
    first, _, third, *_ = SACRE_COEUR
    assert landmarks_of_files(first, third).claims
    assert not landmarks_of_files(first, BERLIN[0]).claims


@needs_photos
@pytest.mark.slow
def test_real_photos_at_full_count() -> None:
    assert (len(SACRE_COEUR), len(BERLIN)) == (10, 3)
    building, street_views, across = (
        [bool(landmarks_of_files(a, b).claims) for a, b in pairs]
        for pairs in (
            combinations(SACRE_COEUR, 2), combinations(BERLIN, 2), product(SACRE_COEUR, BERLIN)
        )
    )  # fmt: skip
    assert (len(building), len(street_views), len(across)) == (45, 3, 30)
    assert sum(building) >= 44 and all(street_views) and not any(across)


def test_a_sphere_is_no_photograph(tmp_path) -> None:
    """Twice as wide as high it has to be told; a panorama's folder gives the other its rig."""
    draws = generator(1, "sphere").integers(0, 256, (16, 32, 3), dtype=np.uint8)
    picture = np.kron(draws, np.ones((16, 16, 1), dtype=np.uint8))
    sphere = tmp_path / "sphere.png"
    sphere.write_bytes(encode_png(picture))
    with pytest.raises(ImageError, match=r"--model equirectangular .* else --model photograph"):
        landmarks_of_files(sphere, sphere)
    with pytest.raises(ImageError, match="expected a model"):
        landmarks_of_files(sphere, sphere, model="flat")
    assert landmarks_of_files(sphere, sphere, model="photograph").rig is None
    found = landmarks_of_files(sphere, sphere, "sift", "equirectangular")
    assert found.rig is not None and found.rig.n_views == 8
    (tmp_path / "kept").mkdir()
    source = Source("equirectangular", columns=300)
    import_panorama(sphere, source).panorama.save(tmp_path / "kept")
    for files in ((sphere, tmp_path / "kept"), (tmp_path / "kept", sphere)):
        assert landmarks_of_files(*files, "sift", "equirectangular").rig != found.rig
