"""What a robot of ours says on ROS topics, in messages of either version."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from vrchain.geometry import Pose
from vrchain.panorama import CameraRig, Codec
from vrchain.robot import Observation
from vrchain.ros.cameras import pose_from_rig
from vrchain.ros.messages import COMPRESSED, IMAGE, INFO, ODOMETRY, SCAN, TF, typestore
from vrchain.simulation.sensors import RANGE_MAX_M


class Messages:
    """Our values as ROS messages, of either version."""

    def __init__(self, ros1: bool) -> None:
        self.ros1, self._types = ros1, typestore(ros1).types

    def make(self, type_: str, **fields: Any) -> Any:
        """A message of a type, ``package/msg/Name``, from all of its fields."""
        return self._types[type_](**fields)

    def header(self, time_ns: int, frame: str) -> Any:
        """A stamped header."""
        seconds, rest = divmod(time_ns, 1_000_000_000)
        stamp = self.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)
        number = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **number)

    def _pose(self, pose: Pose) -> tuple[Any, Any]:
        half = pose.yaw_rad / 2
        turned = {"x": 0.0, "y": 0.0, "z": float(np.sin(half)), "w": float(np.cos(half))}
        return (pose.x_m, pose.y_m, 0.0), self.make("geometry_msgs/msg/Quaternion", **turned)

    def odometry(self, time_ns: int, pose: Pose, frame: str, child: str) -> Any:
        """A pose by odometry; the twist is left zero."""
        (x, y, z), turned = self._pose(pose)
        place = self.make("geometry_msgs/msg/Point", x=x, y=y, z=z)
        zero = {"x": 0.0, "y": 0.0, "z": 0.0}
        still = [self.make("geometry_msgs/msg/Vector3", **zero) for _ in range(2)]
        return self.make(
            ODOMETRY,
            header=self.header(time_ns, frame),
            child_frame_id=child,
            pose=self.make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self.make("geometry_msgs/msg/Pose", position=place, orientation=turned),
                covariance=np.zeros(36),
            ),
            twist=self.make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self.make("geometry_msgs/msg/Twist", linear=still[0], angular=still[1]),
                covariance=np.zeros(36),
            ),
        )

    def transform(self, time_ns: int, parent: str, child: str, pose: Pose | np.ndarray) -> Any:
        """One transform, from ``child`` to ``parent``; a pose on the ground, or (4, 4)."""
        if isinstance(pose, Pose):
            (x, y, z), turned = self._pose(pose)
        else:
            x, y, z = map(float, pose[:3, 3])
            names = dict(
                zip("xyzw", map(float, Rotation.from_matrix(pose[:3, :3]).as_quat()), strict=True)
            )
            turned = self.make("geometry_msgs/msg/Quaternion", **names)
        return self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(time_ns, parent),
            child_frame_id=child,
            transform=self.make(
                "geometry_msgs/msg/Transform",
                translation=self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z),
                rotation=turned,
            ),
        )

    def scan(self, time_ns: int, frame: str, ranges_m: np.ndarray) -> Any:
        """A full turn of ranges, the first straight ahead."""
        step = 2 * np.pi / len(ranges_m)
        return self.make(
            SCAN, header=self.header(time_ns, frame), angle_min=0.0,
            angle_max=2 * np.pi - step, angle_increment=step, time_increment=0.0, scan_time=0.0,
            range_min=0.0, range_max=RANGE_MAX_M, ranges=ranges_m.astype(np.float32),
            intensities=np.zeros(0, np.float32),
        )  # fmt: skip

    def camera_info(self, time_ns: int, frame: str, rig: CameraRig) -> Any:
        """The calibration of one of a rig's views."""
        f, cx, cy = rig.focal_px, rig.width_px / 2 - 0.5, rig.height_px / 2 - 0.5
        arrays = {
            "d": np.zeros(5),
            "k": np.array([f, 0, cx, 0, f, cy, 0, 0, 1.0]),
            "r": np.eye(3).ravel(),
            "p": np.array([f, 0, cx, 0, 0, f, cy, 0, 0, 0, 1.0, 0]),
        }
        roi = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
        return self.make(
            INFO, header=self.header(time_ns, frame), height=rig.height_px, width=rig.width_px,
            distortion_model="plumb_bob", binning_x=0, binning_y=0,
            roi=self.make("sensor_msgs/msg/RegionOfInterest", **roi),
            **{k.upper() if self.ros1 else k: v for k, v in arrays.items()},
        )  # fmt: skip

    def image(self, time_ns: int, frame: str, view: np.ndarray, codec: Codec | None) -> Any:
        """An Image, or with a codec a CompressedImage."""
        header = self.header(time_ns, frame)
        if codec is None:
            height_px, width_px, _ = view.shape
            return self.make(
                IMAGE, header=header, height=height_px, width=width_px, encoding="rgb8",
                is_bigendian=0, step=3 * width_px, data=view.ravel(),
            )  # fmt: skip
        coded = np.frombuffer(codec.encode(view), np.uint8)
        label = f"rgb8; {codec.name} compressed bgr8"
        return self.make(COMPRESSED, header=header, format=label, data=coded)


@dataclass(eq=False)
class RobotTopics:
    """What one robot says on its topics, below its name; a recorder's and a live robot's alike."""

    name: str
    rig: CameraRig
    make: Messages
    codec: Codec | None

    @property
    def base(self) -> str:
        """The robot's own frame, on the ground."""
        return f"{self.name}/base_footprint"

    def fixed(self, time_ns: int) -> list[Any]:
        """Where its cameras and its scanner are."""
        looks = []
        for k in range(self.rig.n_views):
            told = {"bearing_deg": k * 360 / self.rig.n_views}
            pose = pose_from_rig(told | {"height_m": self.rig.camera_height_m})
            looks.append(self.make.transform(time_ns, self.base, self._camera(k), pose))
        return [*looks, self.make.transform(time_ns, self.base, f"{self.name}/laser", np.eye(4))]

    def _camera(self, k: int) -> str:
        return f"{self.name}/camera_{k}_optical"

    def sensed(self, seen: Observation) -> list[tuple[str, Any]]:
        """Topics and messages of odometry and ranges."""
        make, odom, time_ns = self.make, f"{self.name}/odom", seen.time_ns
        moved = make.transform(time_ns, odom, self.base, seen.odometry)
        return [
            (f"/{odom}", make.odometry(time_ns, seen.odometry, odom, self.base)),
            (f"/{self.name}/scan", make.scan(time_ns, f"{self.name}/laser", seen.range_ring_m)),
            ("/tf", make.make(TF, transforms=[moved])),
        ]

    def shown(self, seen: Observation) -> list[tuple[str, Any]]:
        """Topics and messages of its cameras, if it looked."""
        if seen.panorama is None:
            return []
        ending = "" if self.codec is None else "/compressed"
        images = [
            (f"/{self.name}/camera_{k}/image_raw{ending}", self.image(seen.time_ns, k, view))
            for k, view in enumerate(seen.panorama.views)
        ]
        return [*self.informed(seen.time_ns), *images]

    def informed(self, time_ns: int) -> list[tuple[str, Any]]:
        """Topics and messages of its cameras' calibration."""
        return [
            (
                f"/{self.name}/camera_{k}/camera_info",
                self.make.camera_info(time_ns, self._camera(k), self.rig),
            )
            for k in range(self.rig.n_views)
        ]

    def image(self, time_ns: int, camera: int, view: np.ndarray) -> Any:
        """What one camera shows."""
        return self.make.image(time_ns, self._camera(camera), view, self.codec)
