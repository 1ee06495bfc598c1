"""A panorama's landmarks, extracted once and kept: its proposals and its keypoints.

The bytes are canonical: the same panorama, weights and configuration give the same record. Its
numbers are whole multiples of stated steps, so coarse that the last bits in which processors differ
are gone.
"""

import hashlib
import json
import math
import struct
import zlib
from collections.abc import Sequence
from dataclasses import asdict, astuple, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.errors import ImageError, SpecError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import KINDS, Proposals, propose
from vrchain.landmarks.extraction.raster import CELL_PX, ROWS, cells_at, columns_of
from vrchain.landmarks.extraction.sift import Directions, Features, extract
from vrchain.landmarks.extraction.spots import (
    NO_SPOTS,
    Spots,
    described,
    descriptors_of,
    spots_of,
)
from vrchain.landmarks.extraction.weights import SHIPPED, load_network, weights_digest
from vrchain.panorama import CameraRig, Panorama
from vrchain.panorama.panorama import told_by

Array = NDArray[np.float64]

_KEYPOINTS = 4000  # of a panorama, the largest, at most: poses of far pairs rest on the many small
_COARSEST = 15  # of a descriptor's rounded roots, which are kept: 4 bits each
_MAGIC = b"VRLAND\x00\x04"
_MAX_BYTES = 4_000_000
_FARTHEST_M = 10_000.0  # that a robot may have moved since the panorama before, or sees


@dataclass(frozen=True)
class _Fixed:
    """Numbers as whole multiples of a step, of a numpy kind."""

    kind: str
    step: float

    def whole(self, numbers: ArrayLike) -> NDArray[np.integer]:
        """The nearest multiples that there are."""
        limits = np.iinfo(self.kind)
        found = np.round(np.asarray(numbers, dtype=float) / self.step)
        return found.clip(limits.min, limits.max).astype(self.kind)

    def settled(self, numbers: ArrayLike) -> Array:
        """The numbers as they are read again."""
        return np.asarray(self.whole(numbers) * self.step, dtype=float)


_ANGLE = _Fixed("<i2", np.pi / 2**15)
_SLOPE, _SIZE = _Fixed("<i2", 2.0**-13), _Fixed("<u2", 2.0**-13)
_LENGTH = _Fixed("<i4", 2.0**-10)  # metres
_NUMBERS = {
    "score": _Fixed("<u2", 2.0**-15),
    "box": _Fixed("<i2", 2.0**-11),
    "bearing_rad": _ANGLE,
    "range_m": _LENGTH,
    "bearing_std_rad": _Fixed("<u2", 2.0**-14),
    "range_std": _Fixed("<u2", 2.0**-11),
}  # of a proposal
_LOOK = _Fixed("<i1", 1 / 127)
_UNIT = 2.0**10  # embeddings are multiples of 1 / _UNIT, so that products are exact in float32


@dataclass(frozen=True, eq=False)
class LandmarkRecord:
    """What is known of one panorama's landmarks.

    maker: digest of the weights and the configuration; records of another are not compared. moved:
    where the panorama was taken, in the frame of the robot's one before it, by its odometry; None
    if it was the first, or nobody tells.
    """

    rig: CameraRig
    maker: str
    proposals: Proposals
    features: Features
    spots: Spots = NO_SPOTS
    moved: Pose | None = None


def maker_of(weights: Path = SHIPPED) -> str:
    """The digest of weights and configuration, hexadecimal."""
    known = {"weights": weights_digest(weights), "keypoints": _KEYPOINTS, "bits": 4}
    return hashlib.sha256(json.dumps(known, sort_keys=True).encode()).hexdigest()


def examine(
    panorama: Panorama, weights: Path = SHIPPED, features: Features | None = None
) -> LandmarkRecord:
    """Extract a panorama's landmarks. LearnedError without torch or the weights.

    features: all its keypoints, where they are known already.
    """
    proposals, local = propose(panorama, load_network(weights))
    if features is None:
        features = extract(panorama)
    largest = np.sort(np.argsort(-features.size_rad, kind="stable")[:_KEYPOINTS])
    kept = _settled_features(features.take(largest))
    spots = spots_of(proposals, panorama.rig, descriptors_of(proposals, local))
    return LandmarkRecord(panorama.rig, maker_of(weights), _settled(proposals), kept, spots)


def _settled(p: Proposals) -> Proposals:
    """As it is read again: what is claimed of a record does not depend on who asks."""
    numbers: dict[str, Any] = {
        name: fixed.settled(getattr(p, name)) for name, fixed in _NUMBERS.items()
    }
    numbers["range_m"] = numbers["range_m"].clip(0, _FARTHEST_M)
    return replace(p, **numbers, embedding=_unit(_LOOK.whole(p.embedding)))


def _settled_features(f: Features) -> Features:
    bearing_rad = _ANGLE.settled(wrap_angle_rad(f.bearing_rad))
    slope, size_rad = _SLOPE.settled(f.slope), _SIZE.settled(f.size_rad)
    return Features(bearing_rad, slope, size_rad, _roots(f.descriptors) ** 2)


def _unit(whole: NDArray[np.integer]) -> NDArray[np.float32]:
    """Embeddings of length one."""
    wide = whole.astype(float)
    length = np.maximum(np.linalg.norm(wide, axis=1, keepdims=True), 1e-9)
    return np.asarray(np.round(wide / length * _UNIT) / _UNIT, dtype=np.float32)


def examine_quickly(panorama: Panorama, weights: Path = SHIPPED) -> LandmarkRecord:
    """The same in two thirds of the time, as robots under way do: with the larger keypoints alone.

    What that costs is the row *fewer keypoints* in docs/results/landmarks.md: hardly anything.
    """
    return examine(panorama, weights, features=extract(panorama, shrink=2))


def owners(rig: CameraRig, proposals: Proposals, seen: Directions) -> NDArray[np.int64]:
    """The proposal that each keypoint lies in, -1 for none: (n,)."""
    grid = np.full(ROWS // CELL_PX * (columns_of(rig) // CELL_PX), -1)
    grid[proposals.cell] = proposals.owner
    cell, inside = cells_at(seen.bearing_rad, seen.slope, rig)
    return np.where(inside, grid[cell], -1)


def _roots(descriptors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Descriptors as they are kept, (n, 128): of their square roots 4 bits say enough."""
    return np.round(np.sqrt(descriptors.astype(np.float32))).clip(0, _COARSEST).astype(np.uint8)


def encode_record(record: LandmarkRecord) -> bytes:
    """The record as bytes."""
    p, f = record.proposals, record.features
    rows, columns = ROWS // CELL_PX, columns_of(record.rig) // CELL_PX
    grid = np.full(rows * columns, 255, dtype=np.uint8)
    grid[p.cell] = p.owner
    roots = _roots(f.descriptors)
    arrays = [_whole(name, fixed, getattr(p, name)) for name, fixed in _NUMBERS.items()]
    arrays += [p.kind.astype("<u1"), _LOOK.whole(p.embedding), grid]
    arrays += [_ANGLE.whole(wrap_angle_rad(f.bearing_rad)), _SLOPE.whole(f.slope)]
    arrays += [
        _SIZE.whole(f.size_rad),
        roots[:, ::2] << 4 | roots[:, 1::2],
        record.spots.descriptors,
    ]
    header = {
        "rig": asdict(record.rig),
        "maker": record.maker,
        "proposals": len(p),
        "embedded": p.embedding.shape[1],
        "keypoints": len(f),
        "spots": list(record.spots.descriptors.shape),
    }
    if record.moved is not None:
        header["moved"] = list(astuple(_settled_pose(record.moved)))
    table = json.dumps(header, sort_keys=True, separators=(",", ":")).encode()
    body = zlib.compress(b"".join(a.tobytes() for a in arrays), 6)
    return b"".join([_MAGIC, struct.pack(">I", len(table)), table, body])


def _whole(name: str, fixed: _Fixed, numbers: Array) -> NDArray[np.integer]:
    """ImageError for what no robot sees."""
    found = fixed.whole(numbers)
    if not (np.abs(found * fixed.step - numbers) <= fixed.step).all():
        raise ImageError(
            f"landmark record: expected {name} to be a multiple of {fixed.step:g} in "
            f"{8 * np.dtype(fixed.kind).itemsize} bits, got others"
        )
    return found


def decode_record(blob: bytes) -> LandmarkRecord:
    """The record in some bytes; ImageError if they are not exactly one."""
    header, rig, moved, part = read_parts(blob)
    n = len(part["kind"])
    numbers = {name: part[name] * fixed.step for name, fixed in _NUMBERS.items()}
    range_m, kinds, grid = numbers["range_m"], part["kind"].astype(np.int64), part["grid"]
    if not ((range_m >= 0) & (range_m <= _FARTHEST_M)).all():
        raise ImageError(f"landmark record: expected ranges up to {_FARTHEST_M:g} m")
    if (grid[grid < 255] >= n).any() or (kinds >= len(KINDS)).any():
        raise ImageError("landmark record: expected owners and kinds that are there")
    right, left, low, high = numbers["box"].T
    if (right > left).any() or (low > high).any():
        raise ImageError("landmark record: expected boxes whose edges are in order")
    cell = np.flatnonzero(grid < 255)
    proposals = Proposals(
        **numbers, kind=kinds, embedding=_unit(part["embedding"]), cell=cell,
        owner=grid[cell].astype(np.int64),
    )  # fmt: skip
    features = Features(
        part["bearing"] * _ANGLE.step, part["slope"] * _SLOPE.step, part["size"] * _SIZE.step,
        part["descriptors"] ** 2,
    )  # fmt: skip
    spots = part["spots"]
    if len(described(proposals)) != len(spots):
        raise ImageError(
            f"landmark record: {len(spots)} spots described, not {len(described(proposals))}"
        )
    return LandmarkRecord(
        rig, header["maker"], proposals, features, spots_of(proposals, rig, spots), moved
    )


def agree(told: bytes, again: bytes) -> bool:
    """Whether two records may be of one panorama, extracted by robots with other processors.

    Their numbers may differ by one step, at the edge where they are rounded; how the robot moved is
    not asked. ImageError if one is no record.
    """
    (header, *_, part), (other_header, *_, other) = read_parts(told), read_parts(again)
    headers = [{k: v for k, v in h.items() if k != "moved"} for h in (header, other_header)]
    if headers[0] != headers[1]:
        return False
    for name, mine in part.items():
        bits = np.dtype(f"u{mine.dtype.itemsize}")
        apart = mine.view(bits) - other[name].view(bits)  # goes round, as a bearing does
        steps = 0 if name in ("kind", "grid") else 1
        if not (apart + bits.type(steps) <= 2 * steps).all():
            return False
    return True


def read_parts(blob: bytes) -> tuple[dict, CameraRig, Pose | None, dict[str, NDArray]]:
    """Header, rig, how the robot moved, and all else as whole numbers, by name.

    ImageError if the bytes are not exactly one record.
    """
    told, end = told_by(blob, _MAGIC, "a landmark record")
    try:
        header = json.loads(told)
        rig, header["maker"] = CameraRig(**header["rig"]), str(header["maker"])
        n, d, k = (int(header[key]) for key in ("proposals", "embedded", "keypoints"))
        s, local = (int(x) for x in header["spots"])
        moved = _moved(header["moved"]) if "moved" in header else None
        cells = ROWS // CELL_PX * (columns_of(rig) // CELL_PX)
        if not (0 <= n <= 254 and 0 <= k <= _KEYPOINTS and 0 <= s <= cells):
            raise ValueError(f"{n} proposals, {k} keypoints, {s} spots")
        if not (0 < d <= 1024 and 0 < local <= 1024):
            raise ValueError(f"proposals of {d} numbers, spots of {local}")
        layout: dict[str, tuple[str, tuple[int, ...]]] = {
            **{m: (f.kind, (n, 4) if m == "box" else (n,)) for m, f in _NUMBERS.items()},
            "kind": ("<u1", (n,)),
            "embedding": (_LOOK.kind, (n, d)),
            "grid": ("<u1", (cells,)),
            "bearing": (_ANGLE.kind, (k,)),
            "slope": (_SLOPE.kind, (k,)),
            "size": (_SIZE.kind, (k,)),
            "descriptors": ("<u1", (k, 64)),  # two numbers a byte
            "spots": ("<i1", (s, local)),
        }
        size = sum(np.dtype(kind).itemsize * math.prod(shape) for kind, shape in layout.values())
        if size > _MAX_BYTES:
            raise ValueError(f"{size} bytes, at most {_MAX_BYTES} are read")
        unpacker = zlib.decompressobj()
        body = unpacker.decompress(blob[end:], size + 1)
        if len(body) != size or not unpacker.eof or unpacker.unused_data:
            raise ValueError(f"expected {size} bytes, got others")
    except (ValueError, KeyError, TypeError, OverflowError, SpecError, RecursionError,
            zlib.error) as error:  # fmt: skip
        raise ImageError(f"landmark record: unreadable ({error})") from error
    part, place = {}, 0
    for name, (kind, shape) in layout.items():
        part[name] = np.frombuffer(body, kind, math.prod(shape), place).reshape(shape)
        place += part[name].nbytes
    paired = part["descriptors"]
    part["descriptors"] = np.stack([paired >> 4, paired & _COARSEST], axis=2).reshape(k, 128)
    return header, rig, moved, part


def _settled_pose(pose: Pose) -> Pose:
    x_m, y_m = map(float, _LENGTH.settled([pose.x_m, pose.y_m]))
    return Pose(x_m, y_m, float(_ANGLE.settled(wrap_angle_rad(pose.yaw_rad))))


def _moved(numbers: Sequence[float]) -> Pose:
    """ValueError for what no robot drives between two panoramas."""
    x_m, y_m, yaw_rad = map(float, numbers)
    if not np.hypot(x_m, y_m) <= _FARTHEST_M or not abs(yaw_rad) <= np.pi:
        raise ValueError(f"moved by {x_m:g} m, {y_m:g} m, {yaw_rad:g} rad")
    return Pose(x_m, y_m, yaw_rad)
