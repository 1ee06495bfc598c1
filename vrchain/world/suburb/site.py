"""Placing things one after another so that none is in another's way."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import shapely
from numpy.random import Generator

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
    """What is built on a map of ``extent_m``."""

    extent_m: tuple[float, float]
    placements: list[Placement] = field(default_factory=list)
    _taken: list[shapely.Geometry] = field(default_factory=list)
    _kinds: Counter[str] = field(default_factory=Counter)
    _names: Counter[str] = field(default_factory=Counter)

    def keep_free(self, ground: shapely.Geometry) -> None:
        """Let nothing come within the gap of a place."""
        self._taken.append(ground)

    def add(self, kind: str, candidate: Candidate) -> None:
        """Build here, whatever is near; vehicles are called by their plan, others by their kind."""
        word = candidate.plan.name if kind == "vehicle" else kind
        self._kinds[kind] += 1
        self._names[word] += 1
        self.keep_free(candidate.ground)
        name, model = f"{word}_{self._names[word]:02d}", candidate.model
        thing = Placement(
            name, kind, self._kinds[kind], candidate.pose, candidate.plan, model or name
        )
        self.placements.append(thing)

    def is_clear(self, ground: shapely.Geometry) -> bool:
        """Whether a footprint lies on the map, a gap away from all else."""
        half_x, half_y = (e / 2 - 0.3 for e in self.extent_m)
        on_map = shapely.box(-half_x, -half_y, half_x, half_y).covers(ground)
        return on_map and not shapely.dwithin(self._taken, ground, GAP_M).any()

    def fill(
        self,
        kind: str,
        key: str,
        count: int,
        groups: Iterable[Iterable[Candidate]],
        avoid: shapely.Geometry,
        fits: Callable[[Candidate], bool],
    ) -> None:
        """Place ``count`` things, at most one of each group of candidates, off ``avoid``.

        Raises SpecError, naming ``key``, when the groups run out.
        """
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
                    self.add(kind, candidate)
                    placed += 1
                    break


def repeats(count: int, share: float, rng: Generator) -> dict[int, int]:
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
