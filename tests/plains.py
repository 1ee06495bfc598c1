"""A made-up plain of round things, seen without drawing: for missions that take no time."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import sights
from numpy.typing import NDArray

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import Proposals
from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.extraction.spots import NO_SPOTS, ONE, Spots
from vrchain.landmarks.matching.calibration import Calibration
from vrchain.landmarks.matching.common import Comparison, compare
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.landmarks.retrieval.query import Query
from vrchain.landmarks.retrieval.template import LOWEST_SLOPE, Goal, template_around
from vrchain.navigation.goal.recognition import GoalPictures
from vrchain.navigation.perception import Look, Perception
from vrchain.navigation.settings import Published, age_of
from vrchain.panorama import CameraRig
from vrchain.robot import Drive, Observation, beams_rad
from vrchain.seeding import generator

RIG = CameraRig()
BEAMS = beams_rad(72)
RANGE_MAX_M = 8.0
CALIBRATION = Calibration(alike_scale=20.0, alike_even=0.8)
NO_CELLS = np.empty(0, dtype=np.int64)


def everywhere(pose: Pose) -> bool:
    return True


@dataclass(frozen=True, eq=False)
class Thing:
    """A drum covered with points that SIFT would find. looks: whose design it has."""

    name: str
    xy_m: tuple[float, float]
    radius_m: float = 1.5
    height_m: float = 3.0
    n: int = 300
    visible_from: Callable[[Pose], bool] = everywhere
    looks: str | None = None
    share: float = 1.0  # of its points that have the design's look

    def features(self, pose: Pose) -> Features:
        coded = sights.descriptors(self.n, self.looks or self.name)
        coded = np.where(self._own[:, None], sights.descriptors(self.n, self.name), coded)
        facing, bearing, slope = self._shown(pose)
        return sights.features_of(bearing, slope, coded[facing])

    def spots(self, pose: Pose) -> tuple[NDArray, NDArray, NDArray]:
        """Bearings, slopes and descriptors of its points as the network would describe them."""
        coded, own = (
            generator(0, "spots", name).normal(size=(self.n, 32))
            for name in (self.looks or self.name, self.name)
        )
        coded = np.where(self._own[:, None], own, coded)
        coded /= np.linalg.norm(coded, axis=1, keepdims=True)
        facing, bearing, slope = self._shown(pose)
        return bearing, slope, np.round(coded[facing] * ONE).astype(np.int8)

    @property
    def _own(self) -> NDArray[np.bool_]:
        """Points that do not have the design's look."""
        return generator(1, "thing", self.name).uniform(size=self.n) >= self.share

    def _shown(self, pose: Pose) -> tuple[NDArray[np.bool_], NDArray, NDArray]:
        """Which points are in view, and where."""
        draws = generator(0, "thing", self.looks or self.name)
        angle, height = draws.uniform(-np.pi, np.pi, self.n), draws.uniform(0.1, 1, self.n)
        radial = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        at = np.array(self.xy_m) + self.radius_m * radial
        points = np.column_stack([at, self.height_m * height])
        facing = ((pose.xy_m - at) * radial).sum(axis=1) > 0.2 * self.radius_m
        facing &= self.visible_from(pose)
        return facing, *sights.directions(pose, points[facing])


@dataclass(frozen=True, eq=False)
class Plain:
    """Things on open ground."""

    things: tuple[Thing, ...]

    def features(self, pose: Pose) -> Features:
        seen = [t.features(pose) for t in self.things]
        return Features(
            *(
                np.concatenate([getattr(f, key) for f in seen])
                for key in ("bearing_rad", "slope", "size_rad", "descriptors")
            )
        )

    def ring_m(self, pose: Pose) -> NDArray[np.float64]:
        ring = np.full(len(BEAMS), RANGE_MAX_M)
        rays = np.stack([np.cos(BEAMS + pose.yaw_rad), np.sin(BEAMS + pose.yaw_rad)], axis=1)
        for thing in self.things:
            offset = np.array(thing.xy_m) - pose.xy_m
            along, across = rays @ offset, rays @ (offset[::-1] * [1, -1])
            hit = (np.abs(across) < thing.radius_m) & (along > 0)
            near = along - np.sqrt(np.maximum(thing.radius_m**2 - across**2, 0))
            ring = np.where(hit, np.minimum(ring, near), ring)
        return np.clip(ring, 0, RANGE_MAX_M)

    def look(self, pose: Pose) -> Look:
        """What a robot would make of it: each thing in view a proposal."""
        shown = [t for t in self.things if len(t.features(pose))]
        n = len(shown)
        middle = [pose.bearing_to_rad(t.xy_m) for t in shown]
        away = [pose.distance_to_m(t.xy_m) for t in shown]
        side = [max(r - t.radius_m, 0.3) for r, t in zip(away, shown, strict=True)]
        half = [np.arctan2(t.radius_m, r) for r, t in zip(away, shown, strict=True)]
        box = [
            (m - h, m + h, -1 / near, (t.height_m - 1) / near)
            for m, h, near, t in zip(middle, half, side, shown, strict=True)
        ]
        proposals = Proposals(
            np.ones(n), np.array(box).reshape(n, 4), np.array(middle), np.array(away),
            np.full(n, 0.02), np.full(n, 0.1), np.zeros(n, dtype=np.int64),
            np.array([embedding(t.looks or t.name) for t in shown], dtype=np.float32)
            .reshape(n, 64), NO_CELLS, NO_CELLS,
        )  # fmt: skip
        features = self.features(pose)
        return Look(RIG, proposals, lambda: features, spots_of(shown, pose))

    def goal(self, name: str, *azimuths_rad: float) -> GoalPictures:
        """Pictures of one thing from 8 m."""
        (thing,) = (t for t in self.things if t.name == name)
        made, spots, height_m = [], [], []
        for azimuth in azimuths_rad:
            xy = np.array(thing.xy_m) + 8 * np.array([np.cos(azimuth), np.sin(azimuth)])
            pose = Pose(float(xy[0]), float(xy[1]), float(wrap_angle_rad(azimuth + np.pi)))
            alone = Thing(name, thing.xy_m, thing.radius_m, thing.height_m, thing.n)
            seen = alone.features(pose)
            made.append(template_around(seen, 0.0, 0.2, (LOWEST_SLOPE, np.inf)))
            _, slope, code = alone.spots(pose)
            spots.append(code.astype(np.float32) / np.float32(ONE))
            height_m.append(slope * pose.distance_to_m(thing.xy_m))
        shown = Query(embedding(name)[None], np.concatenate(spots), np.concatenate(height_m), ())
        goal = Goal(tuple(made))
        return GoalPictures(shown, goal, CALIBRATION, (8.0,) * len(goal.templates))


def spots_of(shown: Sequence[Thing], pose: Pose) -> Spots:
    """The spots of things in view, each thing a proposal."""
    if not shown:
        return NO_SPOTS
    seen = [t.spots(pose) for t in shown]
    owner = np.repeat(np.arange(len(seen)), [len(code) for _, _, code in seen])
    bearing, slope, code = (np.concatenate(part) for part in zip(*seen, strict=True))
    return Spots(bearing, slope, owner, code)


def embedding(looks: str) -> NDArray[np.float32]:
    """What a design looks like to the network."""
    drawn = generator(0, "embedding", looks).normal(size=64)
    return np.asarray(drawn / np.linalg.norm(drawn), dtype=np.float32)


def compared(a: Look, b: Look) -> Comparison:
    """By keypoints alone."""
    return compare(a.features, b.features, RIG)


def _stored(panorama: bytes, landmarks: bytes | None) -> Look:
    raise AssertionError("a plain's panoramas are no bytes")


PERCEPTION = Perception(lambda seen: seen.panorama.look, _stored, compared, CALIBRATION)  # type: ignore[union-attr]


@dataclass(frozen=True, eq=False)
class Sight:
    """Stands in for a panorama: what would be found in it."""

    look: Look
    rig: CameraRig = RIG

    def shows(self, bearing_rad: float) -> bool:
        return True


@dataclass(eq=False)
class Walker:
    """A robot on a plain, without noise. shut_in: something stands all around it."""

    plain: Plain
    pose: Pose
    shut_in: bool = False
    time_ns: int = 0
    path: list[tuple[float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.start = self.pose

    def observe(self, look: bool = False, towards_rad: float | None = None) -> Observation:
        ring = np.full(len(BEAMS), 0.3) if self.shut_in else self.plain.ring_m(self.pose)
        shown = look or towards_rad is not None
        sight = Sight(self.plain.look(self.pose)) if shown else None
        distance, bearing = (
            self.start.distance_to_m(self.pose.xy_m),
            self.start.bearing_to_rad(self.pose.xy_m),
        )
        odometry = Pose(
            float(distance * np.cos(bearing)),
            float(distance * np.sin(bearing)),
            float(wrap_angle_rad(self.pose.yaw_rad - self.start.yaw_rad)),
        )
        return Observation(self.time_ns, odometry, ring, False, sight)  # type: ignore[arg-type]

    def drive(self, command: Drive, duration_s: float) -> None:
        yaw = self.pose.yaw_rad + command.turn_rad_s * duration_s / 2
        step = command.speed_m_s * duration_s * np.array([np.cos(yaw), np.sin(yaw)])
        x_m, y_m = self.pose.xy_m + (0 if self.shut_in else step)
        turned = float(wrap_angle_rad(self.pose.yaw_rad + command.turn_rad_s * duration_s))
        self.pose = Pose(float(x_m), float(y_m), turned)
        self.time_ns += round(duration_s * 1e9)
        self.path.append((self.pose.x_m, self.pose.y_m))


class PlainIndex(LandmarkIndex[Look]):
    """A ledger's panoramas, by the digest that is the robot's name.

    moved: how robots say that they moved, by the names of the panoramas that they moved to.
    """

    def __init__(
        self, plain: Plain, poses: Mapping[str, Pose], moved: Mapping[str, Pose] | None = None
    ) -> None:
        self.poses = poses

        def look(name: bytes, none: bytes | None) -> Look:
            told = (moved or {}).get(name.decode())
            seen = plain.look(poses[name.decode()])
            return replace(seen, record=cast(Any, told and SimpleNamespace(moved=told)))

        super().__init__(lambda digest: digest, lambda digest: None, look, compared)

    def is_by(self, rig: CameraRig, digest: bytes) -> bool:
        return True

    def published(self) -> dict[str, Published]:
        """The older a panorama by its name, the earlier."""
        return {name: Published(name.encode(), -age_of(name)) for name in self.poses}


GOAL_XY = (16.0, 8.0)
HOME = Pose(0, 0, 0.5)
TEAM = {"R2": Pose(10.0, 4.5, 2.0)}


def beyond(x_m: float):
    """Visible only from east of x."""
    return lambda pose: pose.x_m > x_m


def street(**goal: object) -> Plain:
    """A goal that hides from the west, a landmark on the way, and bystanders."""
    return Plain(
        (
            Thing("goal", GOAL_XY, **{"visible_from": beyond(5.0), **goal}),
            Thing("landmark", (9.0, 1.0), radius_m=1.0),
            Thing("left", (4.0, 9.0)),
            Thing("right", (6.0, -8.0)),
            Thing("far", (18.0, -9.0)),
        )
    )
