"""One robot in bags: its way by odometry, its cameras, and when all of them show one moment."""

import posixpath
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from vrchain.errors import BagError
from vrchain.geometry import Pose, placed, relative, rotation_z, wrap_angle_rad
from vrchain.ros.cameras import (
    Camera,
    Ring,
    check_told,
    lens_from_rig,
    lens_in,
    narrowed,
    pose_from_rig,
    ring_of,
)
from vrchain.ros.contents import OF_TF, Contents, Times, Topic, clocked
from vrchain.ros.formats import Tell
from vrchain.ros.messages import COMPRESSED, IMAGE, INFO, ODOMETRY
from vrchain.yaml_text import load_yaml

_JUMP_M, _JUMP_M_S = 1.0, 3.0  # farther than that, nobody drove: odometry was set anew
_JUMP_RAD, _JUMP_RAD_S = 1.0, 6.0
_SILENT_NS = 1_000_000_000  # without odometry, around a look
_BASES = ("base_footprint", "base_link")
_PREFERRED = ("image_raw", "image_color", "image", "image_mono", "image_rect_color", "image_rect")
_KEYS = {"camera_height_m", "odometry", "cameras"}
_KEYS |= {"laser", "laser_bearing_deg", "velocity", "velocity_stamped"}  # of a live robot


@dataclass(frozen=True, eq=False)
class Way:
    """A robot's way by its odometry: (n,) times and (n, 3) x, y, yaw, without jumps.

    jumps_ns: when odometry was set anew.
    """

    times_ns: Times
    poses: NDArray[np.float64]
    jumps_ns: tuple[int, ...] = ()

    def at(self, time_ns: int) -> Pose | None:
        """Where it was, between two messages on the straight line; None where none is near."""
        after = int(np.searchsorted(self.times_ns, time_ns))
        near = slice(max(0, after - 1), after + 1)
        if np.abs(self.times_ns[near] - time_ns).min(initial=_SILENT_NS + 1) > _SILENT_NS:
            return None
        if (after < len(self.times_ns) and self.times_ns[after] == time_ns) or after == 0:
            return Pose(*map(float, self.poses[after]))
        before = Pose(*map(float, self.poses[after - 1]))
        if after == len(self.times_ns):
            return before
        start, end = (int(t) for t in self.times_ns[near])
        step = relative(before, Pose(*map(float, self.poses[after])))
        share = (time_ns - start) / (end - start)
        return placed(before, Pose(step.x_m * share, step.y_m * share, step.yaw_rad * share))


@dataclass(frozen=True, eq=False)
class Moment:
    """One moment that all cameras show. numbers: of each camera's message in its topic."""

    time_ns: int
    numbers: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Recorded:
    """A robot in bags. topics, labels: of each camera, in the order of ``ring.cameras``. odometry:
    its topic; base: the robot's own frame.
    """

    name: str
    way: Way
    ring: Ring
    topics: tuple[str, ...]
    labels: tuple[str | None, ...]
    odometry: str
    base: str
    moments: tuple[Moment, ...]

    def summary(self) -> dict[str, Any]:
        """What would be used, as plain values and as text."""
        rig, steps = self.ring.rig, np.diff(self.way.poses[:, :2], axis=0)
        driven_m = float(np.hypot(*steps.T).sum())
        made = "as they are" if self.ring.exact else "resampled"
        if self.ring.seen_deg < 360:
            made += f", of which {self.ring.seen_deg:.0f} of 360 degrees are seen"
        return {
            "rig": asdict(rig), "exact": self.ring.exact, "seen_deg": self.ring.seen_deg,
            "moments": len(self.moments), "driven_m": round(driven_m, 2),
            "text": f"{len(self.moments)} moments, {driven_m:.1f} m by odometry; "
            f"{rig.n_views} views of {rig.width_px} x {rig.height_px} pixels and "
            f"{rig.field_of_view_deg:g} degrees, {made}; cameras {rig.camera_height_m:g} m up",
            "cameras": [camera.text() for camera in self.ring.cameras],
        }  # fmt: skip


def load_rig(path: Path | None) -> Mapping[str, Any]:
    """A rig's file; empty without one. BagError."""
    if path is None:
        return {}
    try:
        told = load_yaml(path.read_text())
    except (OSError, yaml.YAMLError, ValueError, KeyError, OverflowError, RecursionError) as error:
        raise BagError(f"cannot read the rig {path}: {error}") from error
    if not isinstance(told, dict) or not {*told} <= _KEYS:
        raise BagError(f"{path}: expected a rig of {', '.join(sorted(_KEYS))}, got {told!r:.80}")
    check_told(path, told.get("cameras", []))
    return told


def robot_in(
    contents: Contents,
    name: str,
    namespace: str,
    rig: Mapping[str, Any],
    slop_s: float,
    tell: Tell = lambda line: None,
) -> Recorded:
    """What the bags hold of the robot whose topics begin with ``namespace``.

    tell: is given a line for what is mended or left out. BagError says what it lacks.
    """
    prefix = namespace.rstrip("/") + "/"
    own = {t.name: t for t in contents.topics.values() if t.name.startswith(prefix)}
    if not own:
        some = ", ".join(sorted({t.split("/")[1] for t in contents.topics})[:8])
        raise BagError(f"{name}: no topic begins with {prefix}; there are /{some}: see bag info")
    contents = contents.of(prefix)
    odometry = _odometry(name, prefix, contents, own, rig, tell)
    way, offset_ns = _way(odometry, tell)
    chosen = _camera_topics(name, prefix, own, rig, tell)
    base = _base(contents, odometry, [topic for topic, _ in chosen])
    cameras, labels = {}, {}
    for topic, told in chosen:
        cameras[topic.name] = _camera(contents, own, topic, told, base)
        labels[topic.name] = told.get("encoding")
        if topic.trouble and not labels[topic.name]:
            raise BagError(f"{topic.name}: {topic.trouble}")
    ring = ring_of([*cameras.values()], rig.get("camera_height_m"))
    order = tuple(camera.topic for camera in ring.cameras)
    times = [_shared_clock(own[topic], offset_ns, tell) for topic in order]
    moments = _moments(name, order, times, round(slop_s * 1e9), tell)
    shown = tuple(labels[topic] for topic in order)
    return Recorded(name, way, ring, order, shown, odometry.name, base, moments)


def robots_in(contents: Contents) -> dict[str, str]:
    """Names and namespaces of what may be robots: each first part of a topic of odometry."""
    odometry = [t.name for t in contents.topics.values() if t.type == ODOMETRY]
    first = {name.split("/")[1] for name in odometry if name.count("/") > 1}
    pictures = [t.name for t in contents.topics.values() if t.type in (IMAGE, COMPRESSED)]
    own = sorted(f for f in first if any(p.startswith(f"/{f}/") for p in pictures))
    return {name: f"/{name}" for name in own} or {"R1": "/"}


def _odometry(
    name: str,
    prefix: str,
    contents: Contents,
    own: Mapping[str, Topic],
    rig: Mapping[str, Any],
    tell: Tell,
) -> Topic:
    """What the rig names, odometry or poses; else odometry; else what transforms tell."""
    found = [t for t in own.values() if t.poses and not t.name.endswith(OF_TF)]
    there = ", ".join(t.name for t in found) or "none"
    if "odometry" in rig:
        wanted = posixpath.join(prefix, str(rig["odometry"]))
        if not (asked := [t for t in found if t.name == wanted]):
            raise BagError(f"{name}: the rig's odometry {wanted} is not there: there is {there}")
    else:
        asked = [t for t in found if t.type == ODOMETRY]
        moved = [contents.topics.get(f"{p}odom{OF_TF}") for p in (prefix, "/")]
        if not asked and (asked := [t for t in moved if t is not None and t.poses][:1]):
            tell(f"{name}: no {ODOMETRY} was recorded: transforms from {asked[0].name} are used")
    if not asked:
        raise BagError(f"{name}: expected {ODOMETRY} under {prefix}, there is {there}: record it")
    asked.sort(key=lambda t: (not t.name.endswith("/odom"), len(t.name), t.name))
    if len(asked) > 1:
        tell(f"{name}: of {len(asked)} topics {asked[0].name} is used; --rig may tell odometry")
    return asked[0]


def _way(topic: Topic, tell: Tell) -> tuple[Way, int]:
    """Its way, and how much later than stamped odometry was received."""
    times, offset_ns, wrong = clocked(topic.stamps_ns, topic.received_ns)
    if wrong:
        tell(f"{topic.name}: {wrong} stamps are zero or step: times of receipt are used there")
    poses = np.frombuffer(topic.poses, float).reshape(-1, 3)
    good = np.isfinite(poses).all(axis=1)
    if not good.any():
        raise BagError(f"{topic.name}: every orientation is null: record odometry with a heading")
    if not good.all():
        tell(f"{topic.name}: {(~good).sum()} messages without orientation or place: left out")
    times, poses = times[good], poses[good]
    later = np.concatenate([[True], times[1:] > np.maximum.accumulate(times)[:-1]])
    times, poses = times[later], poses[later].copy()
    steps = np.diff(poses, axis=0)
    far = is_jump(np.hypot(steps[:, 0], steps[:, 1]), steps[:, 2], np.diff(times) / 1e9)
    jumps = 1 + np.flatnonzero(far)
    for k in jumps:  # go on from where it was
        there, new = poses[k - 1].copy(), poses[k].copy()
        turn_rad = there[2] - new[2]
        poses[k:, :2] = there[:2] + (poses[k:, :2] - new[:2]) @ rotation_z(turn_rad)[:2, :2].T
        poses[k:, 2] = wrap_angle_rad(poses[k:, 2] + turn_rad)
    if len(jumps):
        tell(f"{topic.name}: set anew {len(jumps)} times: no way is told across that")
    return Way(times, poses, tuple(int(t) for t in times[jumps])), offset_ns


def is_jump(way_m: ArrayLike, turn_rad: ArrayLike, seconds: ArrayLike) -> NDArray[np.bool_]:
    """Whether nobody drives so far, or turns so much, in this time."""
    far = np.asarray(way_m) > _JUMP_M + _JUMP_M_S * np.asarray(seconds)
    turned = np.abs(wrap_angle_rad(turn_rad)) > _JUMP_RAD + _JUMP_RAD_S * np.asarray(seconds)
    return np.asarray(far | turned)


def _camera_topics(
    name: str, prefix: str, own: Mapping[str, Topic], rig: Mapping[str, Any], tell: Tell
) -> list[tuple[Topic, Mapping[str, Any]]]:
    """The topics of pictures that are used, each camera once, and what the rig tells of it."""
    if rig.get("cameras"):
        chosen = []
        for told in rig["cameras"]:
            full = posixpath.join(prefix, str(told.get("topic", told.get("rostopic", ""))))
            if full not in own or own[full].type not in (IMAGE, COMPRESSED):
                there = ", ".join(t.name for t in own.values() if t.type in (IMAGE, COMPRESSED))
                raise BagError(f"{name}: the rig's camera {full} is not in the bags; {there} are")
            chosen.append((own[full], told))
        return chosen
    best: dict[str, Topic] = {}
    for topic in own.values():
        if topic.type in (IMAGE, COMPRESSED) and not _is_depth(topic):
            place = camera_name(topic.name)
            best[place] = min(best.get(place, topic), topic, key=_preference)
    if seen := {place: topic for place, topic in best.items() if "infra" not in place}:
        best = seen  # a depth camera's infrared pair shows its pattern of dots
    if not best:
        infos = [t.name for t in own.values() if t.type == INFO]
        lacks = f"only {', '.join(infos)}" if infos else "no camera at all"
        raise BagError(f"{name}: no pictures were recorded under {prefix}, {lacks}: record images")
    return [(topic, {}) for topic in best.values()]


def camera_name(topic: str) -> str:
    """The namespace of a camera's pictures and of its ``camera_info``."""
    parts = topic.split("/")
    if parts[-1] in ("compressed", "image_compressed"):
        parts = parts[:-1] if parts[-1] == "compressed" else parts
    return "/".join(parts[:-1])


def _preference(topic: Topic) -> tuple[int, bool, str]:
    """Pictures as the camera took them before rectified ones, plain before compressed."""
    last = topic.name.removesuffix("/compressed").rpartition("/")[2]
    rank = _PREFERRED.index(last) if last in _PREFERRED else len(_PREFERRED)
    return rank, topic.type == COMPRESSED, topic.name


def _is_depth(topic: Topic) -> bool:
    label = getattr(topic.first, "encoding", getattr(topic.first, "format", ""))
    return "epth" in topic.name or "epth" in label or label.startswith(("16UC1", "32FC1"))


def _base(contents: Contents, odometry: Topic, cameras: Sequence[Topic]) -> str:
    """The robot's own frame: the one that odometry moves, or a usual one."""
    child = getattr(odometry.first, "child_frame_id", "").lstrip("/")
    known = {c for _, c in contents.transforms} | {p for p, _ in contents.transforms.values()}
    prefixes = {topic.frame.rpartition("/")[0] for topic in cameras}
    usual = [f"{p}/{b}".lstrip("/") for p in sorted(prefixes) for b in _BASES]
    return next((frame for frame in (child, *usual) if frame in known), child or _BASES[0])


def _camera(
    contents: Contents, own: Mapping[str, Topic], topic: Topic, told: Mapping[str, Any], base: str
) -> Camera:
    if "field_of_view_deg" in told:
        plain = {k: v for k, v in told.items() if k != "field_of_view_deg"}
        return narrowed(_camera(contents, own, topic, plain, base), told["field_of_view_deg"])
    info = own.get(f"{camera_name(topic.name)}/camera_info")
    if "intrinsics" in told:
        lens = lens_from_rig(topic.name, told, topic.size_px)
    elif info is None or info.first is None:
        raise BagError(f"{topic.name}: no camera_info was recorded for it: give --rig")
    else:
        rectified = "rect" in topic.name.removesuffix("/compressed").rpartition("/")[2]
        lens = lens_in(topic.name, info.first, topic.size_px, rectified)
    if "bearing_deg" in told:
        return Camera(topic.name, lens, pose_from_rig(told))
    frame = topic.frame or (info.frame if info else "")
    pose = contents.pose_in(frame, base)
    if pose is None:
        raise BagError(
            f"{topic.name}: no transform leads from {frame or 'its unnamed frame'} to {base}: give "
            "the bag's first part too, which holds tf_static, or --rig with bearing_deg"
        )
    return Camera(topic.name, lens, pose)


def _shared_clock(topic: Topic, offset_ns: int, tell: Tell) -> Times:
    """The times of a camera's messages, by the clock of odometry."""
    times, own_ns, wrong = clocked(topic.stamps_ns, topic.received_ns)
    if wrong:
        tell(f"{topic.name}: {wrong} stamps are zero or step: times of receipt are used there")
    if abs(own_ns - offset_ns) > 1_000_000_000:
        seconds = (own_ns - offset_ns) / 1e9
        tell(f"{topic.name}: its clock is {-seconds:.1f} s from that of odometry: moved to it")
        times = times + own_ns - offset_ns
    return times


def _moments(
    name: str, topics: Sequence[str], times: Sequence[Times], slop_ns: int, tell: Tell
) -> tuple[Moment, ...]:
    """Each picture of the rarest camera with the nearest of every other, not farther than slop."""
    rarest = min(range(len(times)), key=lambda k: len(times[k]))
    order = [np.argsort(t, kind="stable") for t in times]
    base = times[rarest][order[rarest]]
    nearest, apart = [], []
    for own, by_time in zip(times, order, strict=True):
        sorted_ = own[by_time]
        after = np.searchsorted(sorted_, base).clip(1, max(1, len(own) - 1))
        before = after - 1
        after = np.minimum(after, len(own) - 1)
        pick = np.where(base - sorted_[before] <= sorted_[after] - base, before, after)
        nearest.append(by_time[pick])
        apart.append(own[by_time[pick]])
    spread = np.max(apart, axis=0) - np.min(apart, axis=0)
    good = np.flatnonzero(spread <= slop_ns)
    if not len(good):
        need = np.median(spread) / 1e9
        worst = int(np.argmax(np.median(np.abs(np.stack(apart) - base), axis=1)))
        raise BagError(
            f"{name}: its cameras never show one moment within {slop_ns / 1e9:g} s; "
            f"{topics[worst]} is farthest: they are synchronous to --slop {need * 1.2 + 0.01:.2f}"
        )
    if len(good) < len(base):
        tell(f"{name}: at {len(base) - len(good)} of {len(base)} moments a camera lacks a picture")
    middle = np.sort(np.stack(apart), axis=0)[len(apart) // 2]
    return tuple(Moment(int(middle[k]), tuple(int(n[k]) for n in nearest)) for k in good)
