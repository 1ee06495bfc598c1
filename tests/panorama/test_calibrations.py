from pathlib import Path

import numpy as np
import pytest
import yaml

from vrchain.errors import ImageError
from vrchain.panorama import encode_png
from vrchain.panorama.calibrations import read_cameras
from vrchain.panorama.sources import Source, import_panorama

CAM = {
    "camera_model": "pinhole",
    "intrinsics": [300.0, 301.0, 319.5, 239.5],
    "distortion_model": "radtan",
    "distortion_coeffs": [-0.1, 0.01, 0.0, 0.0],
    "resolution": [640, 480],
}
INFO = {
    "image_width": 640,
    "image_height": 480,
    "camera_name": "front",
    "camera_matrix": {"rows": 3, "cols": 3, "data": [300.0, 0, 319.5, 0, 300.0, 239.5, 0, 0, 1]},
    "distortion_model": "plumb_bob",
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0.0, 0, 0, 0, 0]},
}
# of a camera that looks left, seen from one that looks ahead: x right, y down, z ahead
LEFT = [[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]]


def written(folder: Path, name: str, told: object) -> Path:
    (folder / name).write_text(yaml.safe_dump(told))
    return folder / name


def looks(turn: np.ndarray) -> list[float]:
    """Where a camera's axis lies in the robot's frame."""
    return [float(v) for v in np.round(turn[:, 0], 6) + 0.0]


def test_a_camchain(tmp_path: Path) -> None:
    other = CAM | {"distortion_model": "equidistant", "T_cn_cnm1": LEFT}
    third = CAM | {"T_cn_cnm1": LEFT}
    chain = written(tmp_path, "chain.yaml", {"cam0": CAM, "cam1": other, "cam2": third})
    cameras = read_cameras([chain])
    assert [looks(turn) for _, turn in cameras] == [[1, 0, 0], [0, 1, 0], [-1, 0, 0]]
    assert [lens.equidistant for lens, _ in cameras] == [False, True, False]
    lens = cameras[0][0]
    assert lens.size_px == (640, 480) and lens.focal_px == (300.0, 301.0)
    assert lens.middle_px == (319.5, 239.5) and lens.distortion == (-0.1, 0.01, 0.0, 0.0)


def test_files_of_camera_info(tmp_path: Path) -> None:
    front = written(tmp_path, "front.yaml", INFO)
    message = {"width": 640, "height": 480, "K": INFO["camera_matrix"]["data"], "D": [],
               "distortion_model": "plumb_bob"}  # fmt: skip
    back = written(tmp_path, "back.yaml", message)
    assert [looks(t) for _, t in read_cameras([front, back])] == [[1, 0, 0], [-1, 0, 0]]
    cameras = read_cameras([front, back], [90.0, 0.0])
    assert [looks(turn) for _, turn in cameras] == [[0, 1, 0], [1, 0, 0]]
    with pytest.raises(ImageError, match="each of 2 cameras, got 1"):
        read_cameras([front, back], [90.0])


@pytest.mark.parametrize(
    ("told", "word"),
    [
        (3, "got another YAML"),
        ({}, "no 'camera_matrix'"),
        (INFO | {"camera_matrix": {"data": [0.0] * 9}}, "it was never calibrated"),
        (INFO | {"camera_matrix": {"data": [1.0]}}, "expected a pinhole camera's"),
        (INFO | {"image_width": None}, "expected a pinhole camera's"),
        (INFO | {"image_width": float("inf")}, "expected a pinhole camera's"),
        (INFO | {"camera_matrix": {"data": [10**400] * 9}}, "expected a pinhole camera's"),
        (INFO | {"distortion_model": "ftheta"}, "plumb_bob or equidistant, got ftheta"),
        (INFO | {"distortion_coefficients": {"data": [0.1] * 6}}, "got 6"),
        (INFO | {"distortion_coefficients": {"data": [float("nan")] * 4}}, "expected a pinhole"),
        ({"cam0": CAM | {"camera_model": "omni"}}, "camera_model pinhole, got omni"),
        ({"cam0": CAM, "cam1": CAM}, "cam1: expected a T_cn_cnm1"),
        ({"cam0": CAM, "cam1": CAM | {"T_cn_cnm1": [[1, 2]]}}, "cam1: expected a T_cn_cnm1"),
        ({"cam0": []}, "expected a pinhole"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, told: object, word: str) -> None:
    file = written(tmp_path, "wrong.yaml", told)
    with pytest.raises(ImageError) as refused:
        read_cameras([file])
    assert word in str(refused.value) and "wrong.yaml" in str(refused.value)


def test_what_is_no_yaml(tmp_path: Path) -> None:
    for content in (b"{", b"\xff\xfe", b"[" * 5000):
        (tmp_path / "a.yaml").write_bytes(content)
        with pytest.raises(ImageError, match=r"a\.yaml"):
            read_cameras([tmp_path / "a.yaml"])


def test_front_and_back_are_a_panorama_with_holes(tmp_path: Path) -> None:
    """Each picture is where its camera looks, and the sides are masked."""
    files, pictures = [], []
    for name, level in (("front", 60), ("back", 180)):
        files.append(written(tmp_path, f"{name}.yaml", INFO))
        pictures.append(tmp_path / f"{name}.png")
        pictures[-1].write_bytes(encode_png(np.full((480, 640, 3), level, np.uint8)))
    found = import_panorama(pictures, Source(calibration=tuple(files)))
    panorama = found.panorama
    assert found.about["model"] == "views" and len(found.about["source"]) == 2
    assert panorama.rig.focal_px == pytest.approx(300, rel=0.02)
    assert panorama.seen_cylinder is not None
    middle = len(panorama.cylinder) // 2
    bearing = np.abs(
        np.degrees(panorama.rig.bearing_of_column(np.arange(panorama.cylinder.shape[1])))
    )
    level, seen = panorama.cylinder[middle, :, 0], panorama.seen_cylinder[middle]
    half_deg = np.degrees(np.arctan(320 / 300))
    for which, grey in ((bearing < half_deg - 1, 60), (bearing > 181 - half_deg, 180)):
        assert seen[which].all() and (level[which] == grey).all()
    between = (bearing > half_deg + 1) & (bearing < 179 - half_deg)
    assert not seen[between].any() and not level[between].any()
    with pytest.raises(ImageError, match="each of 2 cameras or bearings, got 1"):
        import_panorama(pictures[:1], Source(calibration=tuple(files)))
    with pytest.raises(ImageError, match="--field-of-view"):
        import_panorama(pictures, Source("views"))
