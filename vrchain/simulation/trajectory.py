"""Trajectories as TUM's RGB-D benchmark writes them, which evo and others read."""

from collections.abc import Iterable

import numpy as np

from vrchain.geometry import Pose


def tum_line(time_ns: int, pose: Pose) -> str:
    """Of one moment: time in s, place in m, and the heading as a quaternion x y z w."""
    half = pose.yaw_rad / 2
    turn = f"0 0 {np.sin(half):.9f} {np.cos(half):.9f}"
    return f"{time_ns / 1e9:.9f} {pose.x_m:.9f} {pose.y_m:.9f} 0 {turn}\n"


def as_tum(trajectory: Iterable[tuple[int, Pose]]) -> str:
    """All of a file: when, in ns, and where."""
    return "".join(tum_line(time_ns, pose) for time_ns, pose in trajectory)
