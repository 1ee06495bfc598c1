"""A panorama: overlapping perspective views around a robot, and the cylinder that joins them.

Columns of the cylinder are bearings. The middle column looks ahead, the left half to the left
(positive bearings); rows are slopes (tangent of elevation), the middle row is the horizon.
"""

import itertools
import json
import struct
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.errors import ImageError, SpecError

MARKER = "panorama.json"
_MAGIC = b"VRPANO\x00\x01"
_MAX_VIEW_BYTES = 16_000_000


@dataclass(frozen=True)
class Codec:
    """How a panorama's views are compressed.

    name: jpeg, webp or png; quality: 0 to 100, for WebP above 100 without loss, for PNG unused.
    """

    name: str
    quality: int = 0

    def __post_init__(self) -> None:
        if self.name not in _QUALITY_FLAGS:
            raise ImageError(f"expected a codec of {', '.join(_QUALITY_FLAGS)}, got {self.name!r}")

    def encode(self, view: NDArray[np.uint8]) -> bytes:
        """The compressed bytes of an RGB image."""
        flag = _QUALITY_FLAGS[self.name]
        flags = [] if flag is None else [flag, self.quality]
        bgr = cv2.cvtColor(view, cv2.COLOR_RGB2BGR)
        return cv2.imencode(f".{self.name}", bgr, flags)[1].tobytes()


_QUALITY_FLAGS = {
    "jpeg": cv2.IMWRITE_JPEG_QUALITY,
    "webp": cv2.IMWRITE_WEBP_QUALITY,
    "png": None,
}
# By `vrchain bench codec`, 24 pairs: it keeps 1.02 (0.97-1.07) of the landmarks found without loss,
# in 0.56 of the bytes of quality 90; below, keypoints go. WebP takes 20 times as long for as much.
STORED = Codec("jpeg", 70)


@dataclass(frozen=True)
class CameraRig:
    """Cameras in a ring on a mast, upright, their optical centres in one point.

    View i looks along bearing i * 360 / n_views degrees. One view alone is an ordinary camera
    looking ahead; more than one must close the ring.
    """

    n_views: int = 8
    width_px: int = 640
    height_px: int = 480
    field_of_view_deg: float = 60.0  # horizontal, of one view
    camera_height_m: float = 1.0

    def __post_init__(self) -> None:
        limits = {
            "n_views": (1, 64),
            "width_px": (16, 4096),
            "height_px": (16, 4096),
            "field_of_view_deg": (5.0, 120.0),
            "camera_height_m": (0.05, 10.0),
        }
        for key, (low, high) in limits.items():
            value = getattr(self, key)
            kind = int if isinstance(low, int) else int | float
            if not isinstance(value, kind) or value is True or not low <= value <= high:
                what = "be a whole number" if kind is int else "lie"
                raise SpecError(f"camera rig: {key} must {what} in {low}..{high}, got {value!r}")
        if self.n_views > 1 and self.n_views * self.field_of_view_deg < 360.0:
            raise SpecError(
                f"camera rig: {self.n_views} views of {self.field_of_view_deg:g} degrees leave "
                "gaps: add views or widen them until together they reach 360 degrees"
            )

    @property
    def focal_px(self) -> float:
        """Focal length of a view."""
        return self.width_px / 2 / float(np.tan(np.radians(self.field_of_view_deg) / 2))

    @property
    def vertical_field_of_view_rad(self) -> float:
        """Vertical opening of a view."""
        return 2 * float(np.arctan(self.height_px / 2 / self.focal_px))

    @property
    def azimuths_rad(self) -> NDArray[np.float64]:
        """Bearing of each view's optical axis, (n_views,)."""
        return 2 * np.pi * np.arange(self.n_views) / self.n_views

    @property
    def span_rad(self) -> float:
        """Azimuth covered by the cylinder: a full turn, or one view's width."""
        return 2 * np.pi if self.n_views > 1 else float(np.radians(self.field_of_view_deg))

    @property
    def closed(self) -> bool:
        """Whether the cylinder's left and right edges meet."""
        return self.n_views > 1

    @property
    def cylinder_shape(self) -> tuple[int, int]:
        """(rows, columns) of the cylinder: full view resolution, rows that every view fills."""
        columns = round(self.focal_px * self.span_rad)
        half_step_rad = self.span_rad / self.n_views / 2
        rows = 2 * int(
            self.height_px / 2 * np.cos(half_step_rad) * columns / self.span_rad / self.focal_px
        )
        return rows, columns

    @property
    def px_per_rad(self) -> float:
        """Cylinder pixels a radian of azimuth; also pixels a unit of slope."""
        return self.cylinder_shape[1] / self.span_rad

    def bearing_of_column(self, column_px: ArrayLike) -> NDArray[np.float64]:
        """Bearings of cylinder columns (pixel centres are whole numbers)."""
        offset = np.asarray(column_px, dtype=float) + 0.5
        return self.span_rad / 2 - offset / self.px_per_rad

    def column_of_bearing(self, bearing_rad: ArrayLike) -> NDArray[np.float64]:
        """Cylinder columns of bearings in [-pi, pi); the inverse of ``bearing_of_column``."""
        return (self.span_rad / 2 - np.asarray(bearing_rad, dtype=float)) * self.px_per_rad - 0.5

    def slope_of_row(self, row_px: ArrayLike) -> NDArray[np.float64]:
        """Slopes (tangent of elevation, up positive) of cylinder rows."""
        rows = self.cylinder_shape[0]
        return (rows / 2 - 0.5 - np.asarray(row_px, dtype=float)) / self.px_per_rad

    def row_of_slope(self, slope: ArrayLike) -> NDArray[np.float64]:
        """Cylinder rows of slopes; the inverse of ``slope_of_row``."""
        return self.cylinder_shape[0] / 2 - 0.5 - np.asarray(slope, dtype=float) * self.px_per_rad

    def view_of_bearing(self, bearing_rad: ArrayLike) -> NDArray[np.int64]:
        """Index of the view whose axis is nearest to each bearing."""
        step = 2 * np.pi / self.n_views
        return np.round(np.asarray(bearing_rad, dtype=float) / step).astype(int) % self.n_views

    def project(
        self, view: ArrayLike, bearing_rad: ArrayLike, slope: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels (x, y) in ``view`` of directions; valid within 90 degrees of the view's axis."""
        delta = np.asarray(bearing_rad, dtype=float) - self.azimuths_rad[np.asarray(view)]
        x_px = self.width_px / 2 - 0.5 - self.focal_px * np.tan(delta)
        y_px = self.height_px / 2 - 0.5 - self.focal_px * np.asarray(slope) / np.cos(delta)
        return x_px, y_px

    def ray_directions(self) -> NDArray[np.float32]:
        """Unit rays of every pixel of every view, robot frame (x ahead, y left, z up).

        (n_views, height_px, width_px, 3) float32.
        """
        left = (self.width_px / 2 - 0.5 - np.arange(self.width_px)) / self.focal_px
        up = (self.height_px / 2 - 0.5 - np.arange(self.height_px)) / self.focal_px
        rays = np.empty((self.n_views, self.height_px, self.width_px, 3), dtype=np.float32)
        for rays_of_view, azimuth in zip(rays, self.azimuths_rad, strict=True):
            rays_of_view[..., 0] = np.cos(azimuth) - left[None, :] * np.sin(azimuth)
            rays_of_view[..., 1] = np.sin(azimuth) + left[None, :] * np.cos(azimuth)
            rays_of_view[..., 2] = up[:, None]
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


@lru_cache(maxsize=8)
def _cylinder_maps(rig: CameraRig) -> list[tuple[slice | NDArray[np.int64], NDArray, NDArray]]:
    """For each view: the cylinder columns it fills, and where in the view to look."""
    rows, columns = rig.cylinder_shape
    bearing = rig.bearing_of_column(np.arange(columns))
    slope = rig.slope_of_row(np.arange(rows))
    owner = rig.view_of_bearing(bearing)
    maps: list[tuple[slice | NDArray[np.int64], NDArray, NDArray]] = []
    for view in range(rig.n_views):
        own = np.flatnonzero(owner == view)
        x_px, y_px = rig.project(view, bearing[own][None, :], slope[:, None])
        whole = own[-1] - own[0] < len(own)  # one stretch is written faster
        maps.append(
            (
                slice(own[0], own[-1] + 1) if whole else own,
                np.broadcast_to(x_px, y_px.shape).astype(np.float32),
                y_px.astype(np.float32),
            )
        )
    return maps


@dataclass(frozen=True, eq=False)
class Panorama:
    """What a robot sees around it at one place.

    views: (n_views, height_px, width_px, 3) uint8 RGB.
    """

    rig: CameraRig
    views: NDArray[np.uint8]

    def __post_init__(self) -> None:
        expected = (self.rig.n_views, self.rig.height_px, self.rig.width_px, 3)
        if self.views.shape != expected or self.views.dtype != np.uint8:
            raise ImageError(
                f"panorama: expected uint8 views of shape {expected}, "
                f"got {self.views.dtype} {self.views.shape}"
            )

    @cached_property
    def cylinder(self) -> NDArray[np.uint8]:
        """The views joined: (rows, columns, 3) uint8 RGB, see ``CameraRig.cylinder_shape``."""
        joined = np.empty((*self.rig.cylinder_shape, 3), dtype=np.uint8)
        for view, (own, x_px, y_px) in zip(self.views, _cylinder_maps(self.rig), strict=True):
            joined[:, own] = cv2.remap(
                view, x_px, y_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
        return joined

    def encode(self, codec: Codec = STORED) -> bytes:
        """One blob: magic, length of the header, JSON header (rig, sizes), the coded views."""
        coded = [codec.encode(view) for view in self.views]
        sizes = [len(c) for c in coded]
        header = {"rig": asdict(self.rig), "codec": codec.name, "view_bytes": sizes}
        table = json.dumps(header, sort_keys=True, separators=(",", ":")).encode()
        return b"".join([_MAGIC, struct.pack(">I", len(table)), table, *coded])

    @classmethod
    def decode(cls, blob: bytes) -> "Panorama":
        """The panorama in a blob; ImageError if it is not exactly one."""
        start = len(_MAGIC) + 4
        if not blob.startswith(_MAGIC) or len(blob) < start:
            raise ImageError("expected an encoded panorama, got other bytes")
        end = start + struct.unpack(">I", blob[len(_MAGIC) : start])[0]
        try:
            header = json.loads(blob[start:end])
            rig, sizes = CameraRig(**header["rig"]), [int(n) for n in header["view_bytes"]]
        except (ValueError, KeyError, TypeError, OverflowError, SpecError, RecursionError) as error:
            raise ImageError(f"encoded panorama: unreadable header ({error})") from error
        ends = np.cumsum([end, *sizes])
        fits = len(sizes) == rig.n_views and ends[-1] == len(blob)
        if not fits or any(not 0 < n <= _MAX_VIEW_BYTES for n in sizes):
            raise ImageError("encoded panorama: its table of views does not fit its bytes")
        views = [_decode_image(blob[a:b], "a view") for a, b in itertools.pairwise(ends)]
        if any(v.shape != (rig.height_px, rig.width_px, 3) for v in views):
            raise ImageError("encoded panorama: a view has another size than its rig says")
        return cls(rig, np.stack(views))

    def save(self, folder: Path) -> None:
        """Write the views, the cylinder (PNG) and the rig (JSON) into an existing folder."""
        for i, view in enumerate(self.views):
            (folder / f"view_{i}.png").write_bytes(encode_png(view))
        (folder / "cylinder.png").write_bytes(encode_png(self.cylinder))
        (folder / MARKER).write_text(json.dumps({"rig": asdict(self.rig)}, indent=2) + "\n")

    @classmethod
    def load(cls, folder: str | Path) -> "Panorama":
        """Read what ``save`` wrote; ImageError names what is missing or wrong."""
        folder = Path(folder)
        try:
            rig = CameraRig(**json.loads((folder / MARKER).read_text())["rig"])
        except FileNotFoundError as error:
            raise ImageError(f"{folder} is no panorama: it holds no {MARKER}") from error
        except (OSError, ValueError, KeyError, TypeError, SpecError, RecursionError) as error:
            raise ImageError(f"{folder / MARKER}: unreadable ({error})") from error
        return cls(rig, np.stack([_view_of(folder, rig, i) for i in range(rig.n_views)]))

    def signature(self) -> NDArray[np.float32]:
        """A small grey cylinder, (16, 180) float32, to judge by how much the view has changed."""
        grey = cv2.cvtColor(self.cylinder, cv2.COLOR_RGB2GRAY)
        return cv2.resize(grey, (180, 16), interpolation=cv2.INTER_AREA).astype(np.float32)


def view_change(before: NDArray[np.float32], now: NDArray[np.float32]) -> float:
    """How much two signatures differ, 0 (same place) to 1 and more, whichever way the robots face.

    One minus the best normalised correlation over all circular shifts, so turning on the spot
    changes nothing. Rows count less their means: sky above and ground below are everywhere.
    """
    a, b = (s - s.mean(axis=1, keepdims=True) for s in (before.astype(float), now.astype(float)))
    scale = np.linalg.norm(a) * np.linalg.norm(b)
    if scale == 0:
        return 0.0 if np.array_equal(before, now) else 1.0
    spectrum = np.fft.rfft(a, axis=1) * np.conj(np.fft.rfft(b, axis=1))
    correlation = np.fft.irfft(spectrum.sum(axis=0), n=a.shape[1])
    return max(0.0, float(1 - correlation.max() / scale))


def read_image(path: str | Path) -> NDArray[np.uint8]:
    """An image file as (h, w, 3) uint8 RGB, turned as its EXIF says; ImageError if it is none."""
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise ImageError(f"cannot read {path}: {error.strerror or error}") from error
    return _decode_image(content, str(path))


def encode_png(image_rgb: NDArray[np.uint8]) -> bytes:
    """PNG bytes of an RGB image."""
    return Codec("png").encode(image_rgb)


def _view_of(folder: Path, rig: CameraRig, index: int) -> NDArray[np.uint8]:
    path = folder / f"view_{index}.png"
    view = read_image(path)
    if view.shape != (rig.height_px, rig.width_px, 3):
        raise ImageError(
            f"{path}: expected {rig.width_px} x {rig.height_px} pixels as {MARKER} says, "
            f"got {view.shape[1]} x {view.shape[0]}"
        )
    return view


def _decode_image(content: bytes, what: str) -> NDArray[np.uint8]:
    try:
        image = (
            cv2.imdecode(np.frombuffer(content, dtype=np.uint8), cv2.IMREAD_COLOR)
            if content
            else None
        )
    except cv2.error as error:
        raise ImageError(f"{what}: the image cannot be decoded ({error.err})") from error
    if image is None:
        raise ImageError(f"{what}: expected an image (JPEG, PNG, ...), got something else")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)
