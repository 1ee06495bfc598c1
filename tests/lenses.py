"""Cameras of every kind in a world far away, in which each direction has its own colour."""

from typing import Any

import cv2
import numpy as np
from sights import RIG

from vrchain.panorama import CameraRig, Panorama
from vrchain.panorama.models import Lens
from vrchain.ros.cameras import Camera, pose_from_rig

FOCAL = RIG.focal_px
BENT = (-0.12, 0.04, 0.001, -0.002, -0.004)
FISHEYE = {
    "size_px": (400, 200),
    "focal_px": (150.0, 150.0),
    "middle_px": (199.5, 99.5),
    "distortion": (0.02, -0.004, 0.001, 0.0),
    "equidistant": True,
}
TILTED = {"pitch_deg": 12, "roll_deg": -4}
HIGH = {"size_px": (320, 320), "focal_px": (150, 150), "middle_px": (160, 158)}


def colours(rays: np.ndarray) -> np.ndarray:
    """A world far away that is smoothly coloured, each direction its own."""
    x, y, z = np.moveaxis(rays / np.linalg.norm(rays, axis=-1, keepdims=True), -1, 0)
    waves = np.stack([np.sin(5 * x + 1), np.sin(6 * y + z), np.sin(9 * z - 2 * x)], axis=-1)
    return (128 + 100 * waves).round().astype(np.uint8)


def seen_by(camera: Camera) -> np.ndarray:
    """What a camera shows of it: OpenCV's own inverse of its model."""
    lens = camera.lens
    width_px, height_px = lens.size_px
    x_px, y_px = np.meshgrid(np.arange(width_px), np.arange(height_px))
    points = np.stack([x_px, y_px], axis=-1).reshape(-1, 1, 2).astype(float)
    if lens.equidistant:
        flat = cv2.fisheye.undistortPoints(points, lens.matrix, np.array(lens.distortion))
    else:
        ends = (cv2.TERM_CRITERIA_COUNT, 60, 0)
        bends = np.array(lens.distortion or (0.0,) * 5)
        flat = cv2.undistortPoints(points, lens.matrix, bends, None, None, None, ends)
    rays = np.column_stack([flat.reshape(-1, 2), np.ones(len(flat))]) @ camera.pose[:3, :3].T
    return colours(rays).reshape(height_px, width_px, 3)


def camera(topic: str = "/c", told: dict[str, float] | None = None, **changed: Any) -> Camera:
    known = {"size_px": (320, 200), "focal_px": (FOCAL, FOCAL), "middle_px": (161.3, 97.2)}
    pose = pose_from_rig({"height_m": 1.2} | (told or {}))
    return Camera(topic, Lens(**(known | changed)), pose)


def truth(rig: CameraRig) -> np.ndarray:
    return Panorama(rig, colours(rig.ray_directions())).cylinder.astype(float)
