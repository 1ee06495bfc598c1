"""A panorama: overlapping perspective views around a robot, and the cylinder that joins them."""

import itertools
import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError, SpecError
from vrchain.geometry import wrap_angle_rad
from vrchain.panorama.codec import (
    STORED,
    Codec,
    decode_image,
    encode_png,
    read_content,
    read_image,
    size_of,
)
from vrchain.panorama.rig import CameraRig

MARKER = "panorama.json"
_SEEN = "seen.png"
SAVED = MARKER, _SEEN, "cylinder.png", "view_*.png"  # patterns of what ``save`` writes
_MAGIC = b"VRPANO\x00\x01"
_MAX_VIEW_BYTES = 16_000_000


@lru_cache(maxsize=8)
def _cylinder_maps(rig: CameraRig) -> list[tuple[slice | NDArray[np.int64], NDArray, NDArray]]:
    """For each view: the cylinder columns it fills, and where in the view to look."""
    rows, n_columns = rig.cylinder_shape
    bearing = rig.bearing_of_column(np.arange(n_columns))
    slope = rig.slope_of_row(np.arange(rows))
    owner = rig.view_of_bearing(bearing)
    maps: list[tuple[slice | NDArray[np.int64], NDArray, NDArray]] = []
    for view in range(rig.n_views):
        own = np.flatnonzero(owner == view)
        x_px, y_px = rig.project(view, bearing[own][None, :], slope[:, None])
        whole = own[-1] - own[0] < len(own)  # one stretch is written faster
        columns = slice(own[0], own[-1] + 1) if whole else own
        x_px = np.broadcast_to(x_px, y_px.shape)
        maps.append((columns, x_px.astype(np.float32), y_px.astype(np.float32)))
    return maps


@dataclass(frozen=True, eq=False)
class Panorama:
    """What a robot sees around it at one place.

    views: (n_views, height_px, width_px, 3) uint8 RGB. seen: (n_views, height_px, width_px) bool,
    what some camera saw; None: all of it. Nothing is looked for in the rest.
    """

    rig: CameraRig
    views: NDArray[np.uint8]
    seen: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        expected = (self.rig.n_views, self.rig.height_px, self.rig.width_px, 3)
        if self.views.shape != expected or self.views.dtype != np.uint8:
            raise ImageError(
                f"panorama: expected uint8 views of shape {expected}, "
                f"got {self.views.dtype} {self.views.shape}"
            )
        if self.seen is not None and (self.seen.shape, self.seen.dtype) != (expected[:3], bool):
            raise ImageError(
                f"panorama: expected what is seen as bool of shape {expected[:3]}, "
                f"got {self.seen.dtype} {self.seen.shape}"
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

    @cached_property
    def seen_cylinder(self) -> NDArray[np.bool_] | None:
        """Which of the cylinder's pixels some camera saw, (rows, columns); None: all of them."""
        if self.seen is None:
            return None
        joined = np.empty(self.rig.cylinder_shape, dtype=bool)
        for seen, (own, x_px, y_px) in zip(self.seen, _cylinder_maps(self.rig), strict=True):
            shown = cv2.remap(
                _as_grey(seen), x_px, y_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            joined[:, own] = np.asarray(shown) == 255
        return joined

    def shows(self, bearing_rad: float) -> bool:
        """Whether any camera looked along a bearing."""
        seen = self.seen_cylinder
        column = round(float(self.rig.column_of_bearing(wrap_angle_rad(bearing_rad))))
        columns = self.rig.cylinder_shape[1]
        if not self.rig.closed and not 0 <= column < columns:
            return False
        return seen is None or bool(seen[:, column % columns].any())

    def view(self, number: int) -> NDArray[np.uint8]:
        """The picture of one camera, (height_px, width_px, 3). ImageError if there is no such."""
        if number not in range(len(self.views)):
            raise ImageError(f"expected a view of 0 to {len(self.views) - 1}, got {number!r}")
        return self.views[number]

    def encode(self, codec: Codec = STORED) -> bytes:
        """One blob: magic, length of the header, JSON header (rig, sizes), the coded views.

        If not all is seen, what is seen follows, all views' below one another, as grey PNG.
        """
        return pack(self.rig, codec.name, [codec.encode(view) for view in self.views], self.seen)

    @classmethod
    def decode(cls, blob: bytes) -> "Panorama":
        """The panorama in a blob; ImageError if it is not exactly one."""
        rig, sizes, masked, end = _header(blob)
        ends = [*itertools.accumulate([end, *sizes])]  # whole numbers of any size
        fits = len(sizes) == rig.n_views and ends[-1] + masked == len(blob) and masked >= 0
        if not fits or any(not 0 < n <= _MAX_VIEW_BYTES for n in sizes):
            raise ImageError("encoded panorama: its table of views does not fit its bytes")
        views = [_view(blob[a:b], rig) for a, b in itertools.pairwise(ends)]
        seen = _seen(blob[ends[-1] :], rig, "encoded panorama") if masked else None
        return cls(rig, np.stack(views), seen)

    @staticmethod
    def rig_of(blob: bytes) -> CameraRig:
        """The cameras that an encoded panorama says it is of; ImageError. No view is opened."""
        return _header(blob)[0]

    def save(self, folder: Path, about: Mapping[str, object] | None = None) -> None:
        """Write the views, the cylinder (PNG) and the rig (JSON) into an existing folder.

        Beside them, if not all is seen, ``seen.png``: all views' below one another. about: what
        else is known of it, plain values, kept beside the rig.
        """
        for i, view in enumerate(self.views):
            (folder / f"view_{i}.png").write_bytes(encode_png(view))
        (folder / "cylinder.png").write_bytes(encode_png(self.cylinder))
        if self.seen is not None:
            mask = cv2.imencode(".png", _as_grey(np.concatenate(self.seen)))[1]
            (folder / _SEEN).write_bytes(mask.tobytes())
        told = {"rig": asdict(self.rig), **(about or {})}
        if self.seen is not None:
            told["masked"] = True
        (folder / MARKER).write_text(json.dumps(told, indent=2) + "\n")

    @classmethod
    def load(cls, folder: str | Path) -> "Panorama":
        """Read what ``save`` wrote; ImageError names what is missing or wrong."""
        folder = Path(folder)
        try:
            told = json.loads((folder / MARKER).read_text())
            rig, masked = CameraRig(**told["rig"]), told.get("masked", False)
        except FileNotFoundError as error:
            raise ImageError(f"{folder} is no panorama: it holds no {MARKER}") from error
        except (OSError, ValueError, KeyError, TypeError, SpecError, RecursionError) as error:
            raise ImageError(f"{folder / MARKER}: unreadable ({error})") from error
        views = []
        for path in (folder / f"view_{i}.png" for i in range(rig.n_views)):
            views.append(read_image(path))
            height_px, width_px, _ = views[-1].shape
            if (width_px, height_px) != (rig.width_px, rig.height_px):
                raise ImageError(
                    f"{path}: expected {rig.width_px} x {rig.height_px} pixels as {MARKER} says, "
                    f"got {width_px} x {height_px}"
                )
        seen = _seen(read_content(folder / _SEEN), rig, str(folder / _SEEN)) if masked else None
        return cls(rig, np.stack(views), seen)

    def signature(self) -> NDArray[np.float32]:
        """A small grey cylinder, (16, 180) float32, to judge by how much the view has changed."""
        grey = cv2.cvtColor(self.cylinder, cv2.COLOR_RGB2GRAY)
        if self.seen_cylinder is not None:  # the rest says nothing, as if it were its row's mean
            level = np.ma.masked_array(grey, ~self.seen_cylinder).mean(axis=1).filled(0)
            grey = np.where(self.seen_cylinder, grey, level[:, None].astype(np.uint8))
        return cv2.resize(grey, (180, 16), interpolation=cv2.INTER_AREA).astype(np.float32)


def _as_grey(seen: NDArray[np.bool_]) -> NDArray[np.uint8]:
    return seen.astype(np.uint8) * np.uint8(255)


def told_by(blob: bytes, magic: bytes, what: str) -> tuple[bytes, int]:
    """The header of something encoded, magic, length, header, and where it ends. ImageError."""
    start = len(magic) + 4
    if not blob.startswith(magic) or len(blob) < start:
        raise ImageError(f"expected {what}, got other bytes")
    end = start + struct.unpack(">I", blob[len(magic) : start])[0]
    return blob[start:end], end


def _header(blob: bytes) -> tuple[CameraRig, list[int], int, int]:
    """Rig, the bytes of each view and of the mask, and where the views begin."""
    told, end = told_by(blob, _MAGIC, "an encoded panorama")
    try:
        header = json.loads(told)
        rig, sizes = CameraRig(**header["rig"]), [int(n) for n in header["view_bytes"]]
        return rig, sizes, int(header.get("seen_bytes", 0)), end
    except (ValueError, KeyError, TypeError, OverflowError, SpecError, RecursionError) as error:
        raise ImageError(f"encoded panorama: unreadable header ({error})") from error


def _view(coded: bytes, rig: CameraRig) -> NDArray[np.uint8]:
    """A view of the rig's size: so much its head says, before memory is asked for, and it has."""
    if size_of(coded, "a view") == (rig.width_px, rig.height_px):
        view = decode_image(coded, "a view")
        if view.shape == (rig.height_px, rig.width_px, 3):  # metadata may turn it
            return view
    raise ImageError("encoded panorama: a view has another size than its rig says")


def _seen(content: bytes, rig: CameraRig, what: str) -> NDArray[np.bool_]:
    """What is seen, of its PNG's bytes: (n_views, height_px, width_px)."""
    if size_of(content, what) == (rig.width_px, rig.n_views * rig.height_px):
        shown = decode_image(content, what)[..., 0] > 127
        if shown.shape == (rig.n_views * rig.height_px, rig.width_px):  # metadata may turn it
            return shown.reshape(rig.n_views, rig.height_px, rig.width_px)
    raise ImageError(f"{what}: what is seen has another size than the rig's views together")


def pack(
    rig: CameraRig,
    codec_name: str,
    coded: Sequence[bytes],
    seen: NDArray[np.bool_] | None = None,
) -> bytes:
    """The blob of a panorama whose views are coded already."""
    header: dict[str, object] = {"rig": asdict(rig), "codec": codec_name}
    header["view_bytes"] = [len(c) for c in coded]
    mask = b""
    if seen is not None:
        mask = cv2.imencode(".png", _as_grey(np.concatenate(seen)))[1].tobytes()
        header["seen_bytes"] = len(mask)
    table = json.dumps(header, sort_keys=True, separators=(",", ":")).encode()
    return b"".join([_MAGIC, struct.pack(">I", len(table)), table, *coded, mask])


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
