"""Placing things one after another so that none is in another's way."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely

from vrchain.errors import SpecError
from vrchain.geometry import Pose, rotation_z

GAP_M = 1.0  # between any two solid things; a robot is 0.8 m wide


@dataclass(frozen=True)
class Placement:
    """A thing to build: ``plan`` is what its builder takes, ``index`` counts its kind from 1.

    ``model`` is the name of the placement whose model this one shows: its own, or its twin's.
    """

    name: str
    kind: str
    index: int
    pose: Pose
    plan: Any
    model: str


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place that a thing could take; ``shape`` is its footprint in its own frame."""

    pose: Pose
    shape: shapely.Geometry
    plan: Any = None
    model: str | None = None  # the name of the placed thing that this one would repeat

    @property
    def ground(self) -> shapely.Geometry:
        """The footprint in the world."""
        turn = rotation_z(self.pose.yaw_rad)[:2, :2]
        return shapely.transform(self.shape, lambda xy: xy @ turn.T + self.pose.xy_m)


@dataclass
class Site:
    """What is built on a map of ``extent_m``, with circles around it for a quick first look."""

    extent_m: tuple[float, float]
    placements: list[Placement] = field(default_factory=list)
    _shapes: list[shapely.Geometry] = field(default_factory=list)
    _circles: list[tuple[float, float, float]] = field(default_factory=list)
    _kinds: Counter[str] = field(default_factory=Counter)
    _names: Counter[str] = field(default_factory=Counter)

    def keep_free(self, ground: shapely.Geometry) -> None:
        """Let nothing come within the gap of a place."""
        self._shapes.append(ground)
        self._circles.append(_circle(ground))

    def add(self, kind: str, candidate: Candidate, name: str | None = None) -> None:
        """Build here, whatever is near; ``name`` without its number, by default the kind."""
        name = name or kind
        self._kinds[kind] += 1
        self._names[name] += 1
        self.keep_free(candidate.ground)
        name = f"{name}_{self._names[name]:02d}"
        self.placements.append(
            Placement(
                name,
                kind,
                self._kinds[kind],
                candidate.pose,
                candidate.plan,
                candidate.model or name,
            )
        )

    def is_clear(self, ground: shapely.Geometry) -> bool:
        """Whether a footprint lies on the map, a gap away from all else."""
        half_x, half_y = (e / 2 - 0.3 for e in self.extent_m)
        x0, y0, x1, y1 = ground.bounds
        if x0 < -half_x or y0 < -half_y or x1 > half_x or y1 > half_y:
            return False
        if not self._shapes:
            return True
        x, y, radius = _circle(ground)
        circles = np.array(self._circles)
        near = np.hypot(circles[:, 0] - x, circles[:, 1] - y) < circles[:, 2] + radius + GAP_M
        others = np.array(self._shapes, dtype=object)[near]
        return not len(others) or float(shapely.distance(others, ground).min()) >= GAP_M

    def fill(
        self,
        kind: str,
        key: str,
        count: int,
        groups: Iterable[Iterable[Candidate]],
        *,
        avoid: shapely.Geometry | None = None,
        fits: Callable[[Candidate], bool] = lambda _: True,
    ) -> None:
        """Place ``count`` things, at most one of each group of candidates, off ``avoid``.

        Raises SpecError, naming ``key``, when the groups run out.
        """
        avoid = avoid or shapely.Polygon()
        shapely.prepare(avoid)
        placed = 0
        groups = iter(groups)
        while placed < count:
            group = next(groups, None)
            if group is None:
                raise SpecError(f"{key}: {count} do not fit this layout, allowed here 0..{placed}")
            for candidate in group:
                ground = candidate.ground
                if not avoid.intersects(ground) and fits(candidate) and self.is_clear(ground):
                    self.add(kind, candidate, getattr(candidate.plan, "name", None))
                    placed += 1
                    break


def repeats(count: int, share: float, rng: np.random.Generator) -> dict[int, int]:
    """Which of ``count`` things are twins, and which earlier thing, no twin, each repeats."""
    twins = set((1 + rng.permutation(count - 1))[: round(share * count)]) if count > 1 else set()
    found: dict[int, int] = {}
    originals: list[int] = []
    for k in range(count):
        if k in twins:
            found[k] = originals[int(rng.integers(len(originals)))]
        else:
            originals.append(k)
    return found


def _circle(shape: shapely.Geometry) -> tuple[float, float, float]:
    x0, y0, x1, y1 = shape.bounds
    return (x0 + x1) / 2, (y0 + y1) / 2, float(np.hypot(x1 - x0, y1 - y0)) / 2
