"""A panorama: overlapping perspective views around a robot, and the cylinder that joins them."""

import itertools
import json
import struct
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError, SpecError
from vrchain.panorama.codec import STORED, Codec, decode_image, encode_png, read_image
from vrchain.panorama.rig import CameraRig

MARKER = "panorama.json"
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
        return pack(self.rig, codec.name, [codec.encode(view) for view in self.views])

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
        views = [decode_image(blob[a:b], "a view") for a, b in itertools.pairwise(ends)]
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
        views = []
        for path in (folder / f"view_{i}.png" for i in range(rig.n_views)):
            views.append(read_image(path))
            height_px, width_px, _ = views[-1].shape
            if (width_px, height_px) != (rig.width_px, rig.height_px):
                raise ImageError(
                    f"{path}: expected {rig.width_px} x {rig.height_px} pixels as {MARKER} says, "
                    f"got {width_px} x {height_px}"
                )
        return cls(rig, np.stack(views))

    def signature(self) -> NDArray[np.float32]:
        """A small grey cylinder, (16, 180) float32, to judge by how much the view has changed."""
        grey = cv2.cvtColor(self.cylinder, cv2.COLOR_RGB2GRAY)
        return cv2.resize(grey, (180, 16), interpolation=cv2.INTER_AREA).astype(np.float32)


def pack(rig: CameraRig, codec_name: str, coded: Sequence[bytes]) -> bytes:
    """The blob of a panorama whose views are coded already."""
    header = {"rig": asdict(rig), "codec": codec_name, "view_bytes": [len(c) for c in coded]}
    table = json.dumps(header, sort_keys=True, separators=(",", ":")).encode()
    return b"".join([_MAGIC, struct.pack(">I", len(table)), table, *coded])


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
