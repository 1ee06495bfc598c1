"""The ring of cameras: where a pixel column of the cylinder looks, and which pixel shows a bearing.

Columns of the cylinder are bearings. The middle column looks ahead, the left half to the left
(positive bearings); rows are slopes (tangent of elevation), the middle row is the horizon.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.errors import SpecError

MOST_SIDE_PX = 4096  # of one view
_MOST_PX = 2**27  # of all views: 400 MB


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
            "width_px": (16, MOST_SIDE_PX),
            "height_px": (16, MOST_SIDE_PX),
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
        columns = self.cylinder_shape[1]
        if columns < 2 * self.n_views or self.n_views * self.width_px * self.height_px > _MOST_PX:
            raise SpecError(
                f"camera rig: expected 2 columns of the cylinder for each view and {_MOST_PX:,} "
                f"pixels at most, got {columns} columns for {self.n_views} views of "
                f"{self.width_px} x {self.height_px}"
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
