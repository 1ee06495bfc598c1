"""Calibrated cameras from files: a kalibr camchain, or ROS ``camera_info``, one file a view."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.geometry import rotation_z
from vrchain.panorama.codec import read_content
from vrchain.panorama.models import Lens

Mounted = tuple[Lens, NDArray[np.float64]]
"""A lens, and the rotation (3, 3) from its frame (x ahead, y left, z up) to the robot's."""
OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # z ahead, x right
_EQUIDISTANT = ("equidistant", "fisheye", "kannala_brandt", "kannala_brandt4")
_POLYNOMIAL = ("radtan", "radial-tangential", "plumb_bob", "rational_polynomial", "none", "")


def read_cameras(files: Sequence[Path], bearings_deg: Sequence[float] = ()) -> list[Mounted]:
    """The cameras of a kalibr camchain (one file), or of one ``camera_info`` file each.

    bearings_deg: where each looks, anticlockwise from ahead. Without, those of a camchain as its
    ``T_cn_cnm1`` say, the first one ahead; others in equal steps. ImageError names the file.
    """
    tables = [_table(file) for file in files]
    if len(files) == 1 and "cam0" in tables[0]:
        chain = [tables[0][f"cam{k}"] for k in range(len(tables[0])) if f"cam{k}" in tables[0]]
        lenses = [_lens(camera, _of_kalibr, files[0]) for camera in chain]
        turns = _chained(chain, files[0])
    else:
        lenses = [_lens(t, _of_ros, f) for t, f in zip(tables, files, strict=True)]
        turns = [rotation_z(2 * np.pi * k / len(lenses)) for k in range(len(lenses))]
    if bearings_deg:
        if len(bearings_deg) != len(lenses):
            raise ImageError(
                f"expected a bearing for each of {len(lenses)} cameras, got {len(bearings_deg)}"
            )
        turns = [rotation_z(float(np.radians(bearing))) for bearing in bearings_deg]
    return list(zip(lenses, turns, strict=True))


def _table(file: Path) -> dict[str, Any]:
    try:
        told = yaml.safe_load(read_content(file))
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, OverflowError, RecursionError) as error:
        raise ImageError(f"{file}: expected a camera's calibration in YAML ({error})") from error
    if not isinstance(told, dict):
        raise ImageError(f"{file}: expected a kalibr camchain or camera_info, got another YAML")
    return told


def _lens(told: Any, reader: Callable[[Any], Lens], file: Path) -> Lens:
    try:
        return reader(told)
    except (KeyError, TypeError, ValueError, OverflowError, IndexError) as error:
        why = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise ImageError(
            f"{file}: expected a pinhole camera's kalibr camchain or camera_info: {why}"
        ) from error


def _of_kalibr(told: Mapping[str, Any]) -> Lens:
    if told["camera_model"] != "pinhole":
        raise ValueError(f"expected camera_model pinhole, got {told['camera_model']}")
    fx, fy, cx, cy = map(float, told["intrinsics"])
    width_px, height_px = map(int, told["resolution"])
    return _made((width_px, height_px), (fx, fy, cx, cy), told, "distortion_coeffs")


def _of_ros(told: Mapping[str, Any]) -> Lens:
    matrix = told["camera_matrix"] if "camera_matrix" in told else told.get("K", told.get("k"))
    data = matrix["data"] if isinstance(matrix, dict) else matrix
    if data is None:
        raise KeyError("camera_matrix")
    fx, _, cx, _, fy, cy, *_ = map(float, data)
    size = told.get("image_width", told.get("width")), told.get("image_height", told.get("height"))
    given = next((n for n in ("distortion_coefficients", "D", "d") if n in told), "")
    return _made((int(size[0]), int(size[1])), (fx, fy, cx, cy), told, given)


def _made(
    size_px: tuple[int, int], inner: tuple[float, ...], told: Mapping[str, Any], where: str
) -> Lens:
    given = told.get(where) or ()
    given = given["data"] if isinstance(given, dict) else given
    return lens_of(size_px, inner, str(told.get("distortion_model", "")), given)


def lens_of(
    size_px: tuple[int, int], inner: Sequence[float], model: str, distortion: Iterable[float]
) -> Lens:
    """A lens by the numbers that calibrations tell: fx, fy, cx, cy, the name of the distortion's
    model and its coefficients. ValueError says what is wrong."""
    name, given = model.lower(), tuple(map(float, distortion))
    if name not in (*_EQUIDISTANT, *_POLYNOMIAL):
        raise ValueError(f"expected distortion radtan, plumb_bob or equidistant, got {name}")
    if len(inner) != 4:
        raise ValueError(f"expected four intrinsics, fx, fy, cx, cy, got {len(inner)}")
    fx, fy, cx, cy = inner
    if min(*size_px, fx, fy) <= 0 or not np.isfinite([fx, fy, cx, cy, *given]).all():
        raise ValueError("a size or focal length of nought: it was never calibrated")
    if name in _EQUIDISTANT:
        given = (*given, 0.0, 0.0, 0.0, 0.0)[:4]
    elif given and len(given) not in (4, 5, 8, 12, 14):
        raise ValueError(f"expected 4, 5, 8, 12 or 14 distortion coefficients, got {len(given)}")
    return Lens(size_px, (fx, fy), (cx, cy), given, name in _EQUIDISTANT)


def _chained(chain: Sequence[Mapping[str, Any]], file: Path) -> list[NDArray[np.float64]]:
    """Rotations from each camera's frame to the first one's, which looks ahead."""
    turn = np.eye(3)
    turns = [turn]
    for number, camera in enumerate(chain[1:], 1):
        try:
            step = np.array(camera["T_cn_cnm1"], dtype=float)[:3, :3]
            if not np.allclose(step @ step.T, np.eye(3), atol=1e-2):
                raise ValueError("no rotation")
        except (KeyError, TypeError, ValueError, OverflowError, IndexError) as error:
            raise ImageError(f"{file}: cam{number}: expected a T_cn_cnm1 of 4 x 4") from error
        turn = step @ turn  # from the first camera's optical frame to this one's
        turns.append(OPTICAL.T @ turn.T @ OPTICAL)
    return turns
