"""Bags as the drivers of usual cameras and robots record them: one eye ahead, two around."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from lenses import BENT, FISHEYE, camera, seen_by, truth
from recordings import START_NS, Row, fields, published, write
from sights import RIG

from vrchain.errors import BagError
from vrchain.geometry import Pose
from vrchain.ledger import Ledger
from vrchain.panorama import Codec, Panorama
from vrchain.panorama.calibrations import OPTICAL
from vrchain.ros.cameras import Camera
from vrchain.ros.messages import IMAGE, TF
from vrchain.ros.telling import Messages

MAKE = Messages(False)
AHEAD = camera(distortion=BENT)
CODEC = Codec("jpeg", 95)


def mount(eye: Camera) -> np.ndarray:
    """From a link that looks where the eye does, x ahead, to the robot's frame."""
    pose = eye.pose.copy()
    pose[:3, :3] = eye.pose[:3, :3] @ OPTICAL
    return pose


def turned_optical() -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = OPTICAL.T
    return pose


def info(eye: Camera, time_ns: int, frame: str) -> Any:
    """Its CameraInfo as its driver has it."""
    lens, told = eye.lens, MAKE.camera_info(time_ns, frame, RIG)
    projection = np.column_stack([lens.matrix, np.zeros(3)]).ravel()
    return fields(
        told, width=lens.size_px[0], height=lens.size_px[1], k=lens.matrix.ravel(), p=projection,
        distortion_model="equidistant" if lens.equidistant else "plumb_bob",
        d=np.array(lens.distortion or (0.0,) * 5),
    )  # fmt: skip


def shown(eye: Camera, time_ns: int, frame: str, encoding: str) -> Any:
    picture = seen_by(eye)
    if encoding == "jpeg":
        return MAKE.image(time_ns, frame, picture, CODEC)
    plain = MAKE.image(time_ns, frame, picture, None)
    if encoding == "rgb8":
        return plain
    code = {"bgra8": cv2.COLOR_RGB2BGRA, "mono8": cv2.COLOR_RGB2GRAY}[encoding]
    other = np.ascontiguousarray(cv2.cvtColor(picture, code))
    step = other.nbytes // len(other)
    return fields(plain, encoding=encoding, step=step, data=other.ravel())


def recorded(eyes: dict[str, tuple[Camera, str, str]], odom: str, base: str) -> Iterable[Row]:
    """Six seconds on straight. eyes: of each topic of pictures its camera, encoding and frame."""
    fixed = []
    for eye, _, frame in eyes.values():
        link = frame.removesuffix("_optical_frame") + "_link"
        fixed += [(base, link, mount(eye)), (link, frame, turned_optical())]
    transforms = [MAKE.transform(START_NS, *told) for told in fixed]
    yield Row("/tf_static", MAKE.make(TF, transforms=transforms), START_NS)
    for tick in range(60):
        now_ns = START_NS + tick * 100_000_000
        told = MAKE.odometry(now_ns, Pose(0.1 * tick, 0.0), "odom", base)
        yield Row(odom, told, now_ns)
        for topic, (eye, encoding, frame) in eyes.items() if tick % 10 == 0 else ():
            place = topic.removesuffix("/compressed").rpartition("/")[0]
            yield Row(f"{place}/camera_info", info(eye, now_ns, frame), now_ns)
            yield Row(topic, shown(eye, now_ns, frame, encoding), now_ns)


def first_panorama(rows: Iterable[Row], folder: Path, namespace: str, **more: Any) -> Panorama:
    """Of what is published of them."""
    told = {"robots": {"R1": namespace}} | more
    outcome = published([write(rows, folder / "bag")], folder / "ledger", **told)
    assert outcome.times_s[0] == 0.0 and outcome.played.broken == 0
    with Ledger.open(folder / "ledger") as ledger:
        return Panorama.decode(ledger.payload(bytes.fromhex(outcome.digests[0])))


def seen_deg(panorama: Panorama) -> float:
    level = panorama.seen_cylinder[panorama.cylinder.shape[0] // 2]
    return float(level.mean() * 360)


def off(panorama: Panorama) -> np.ndarray:
    apart = np.abs(panorama.cylinder - truth(panorama.rig))
    return apart[panorama.seen_cylinder]


BACK = camera("/back", {"bearing_deg": 180}, **FISHEYE)
FRONT = camera("/front", **FISHEYE)
GREY = camera("/infra", size_px=(320, 200))
ROBOTS = {
    "turtlebot3": (
        {"/camera/image_raw/compressed": (AHEAD, "jpeg", "camera_rgb_optical_frame")},
        "/odom", "base_footprint", "/", (50, 62),
    ),
    "zed": (
        {"/zed/zed_node/left_raw/image_raw_color": (AHEAD, "bgra8", "zed_left_optical_frame")},
        "/zed/zed_node/odom", "base_link", "/zed", (50, 62),
    ),
    "front and back": (
        {
            "/front/image_raw": (FRONT, "rgb8", "front_optical_frame"),
            "/back/image_raw/compressed": (BACK, "jpeg", "back_optical_frame"),
        },
        "/wheels/odom", "base_link", "/", (290, 330),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ROBOTS)
def test_what_it_sees_is_published_with_its_holes(name: str, tmp_path: Path) -> None:
    eyes, odom, base, namespace, (least_deg, most_deg) = ROBOTS[name]
    panorama = first_panorama(recorded(eyes, odom, base), tmp_path, namespace)
    assert least_deg < seen_deg(panorama) < most_deg and panorama.seen is not None
    assert off(panorama).mean() < 2 and np.percentile(off(panorama), 99) < 12
    assert panorama.rig.camera_height_m == 1.2


def test_depth_beside_pictures_is_no_camera(tmp_path: Path) -> None:
    """As RealSense's driver has it; depth is labelled as pixels of 16 bits."""
    eyes = {"/camera/camera/color/image_raw": (AHEAD, "rgb8", "camera_color_optical_frame")}
    rows = list(recorded(eyes, "/odom", "base_link"))
    deep = [
        replace(row, topic=row.topic.replace("color", "depth").replace("raw", "rect_raw"))
        for row in rows
        if row.message.__msgtype__ == IMAGE
    ]
    deep = [
        replace(row, message=fields(row.message, encoding="16UC1", step=640, data=row.message.data))
        for row in deep
    ]
    infrared = [
        replace(row, topic=row.topic.replace("color", "infra1").replace("raw", "rect_raw"))
        for row in rows
        if "/camera/camera/color" in row.topic
    ]
    panorama = first_panorama([*rows, *deep, *infrared], tmp_path, "/")
    assert 50 < seen_deg(panorama) < 62 and off(panorama).mean() < 2


def test_a_webcam_that_nobody_calibrated(tmp_path: Path) -> None:
    """usb_cam's frame has no transform, its camera_info zeros: a rig tells what it is."""
    eyes = {"/usb_cam/image_raw/compressed": (AHEAD, "jpeg", "usb_cam_optical_frame")}
    zero = {"k": np.zeros(9), "p": np.zeros(12)}
    rows = [
        replace(row, message=fields(row.message, **zero)) if "info" in row.topic else row
        for row in recorded(eyes, "/odom", "base_link")
        if row.topic != "/tf_static"
    ]
    with pytest.raises(BagError, match=r"holds no calibration.*give --rig"):
        published([write(rows, tmp_path / "a")], tmp_path / "none", robots={"R1": "/"})
    (fx, fy), (cx, cy) = AHEAD.lens.focal_px, AHEAD.lens.middle_px
    rig = tmp_path / "rig.yaml"
    rig.write_text(
        "camera_height_m: 1.2\ncameras:\n  - topic: usb_cam/image_raw/compressed\n"
        f"    intrinsics: [{fx}, {fy}, {cx}, {cy}]\n    bearing_deg: 0\n"
        f"    distortion_model: plumb_bob\n    distortion_coeffs: {list(BENT)}\n"
    )
    panorama = first_panorama(rows, tmp_path, "/", rig=rig)
    assert 50 < seen_deg(panorama) < 62 and off(panorama).mean() < 2
    rig.write_text(rig.read_text() + "    field_of_view_deg: 40\n")
    assert 39 < seen_deg(first_panorama(rows, tmp_path / "less", "/", rig=rig)) < 41
