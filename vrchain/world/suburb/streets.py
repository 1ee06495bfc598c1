"""Where streets run: centre lines, and the polygons of what is paved.

Long streets lie side by side along x or along y, and others cross them. Most run from edge to
edge, some only to another street (a T-junction) or to a turning circle (a dead end). Streets that
reach the map's edge run on beyond it, so that the view along them does not end there.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.random import Generator
from shapely import affinity, ops

from vrchain.geometry import Pose
from vrchain.world.spec import SceneSpec

BEYOND_M = 100.0  # how far the ground goes on outside the map
KERB_M = 0.15
TURNING_M = 3.5  # how much wider than half the street a turning circle is
_CORNER_M = 3.0  # radius of street corners
_TURN_RAD = 0.06  # of the whole pattern, at most
_STEP_M = 4.0  # between the corners of a centre line
_ROW_M = 54.0  # a street with lots on both sides
_SHORTEST_M = 17.0  # of a street on the map
START_XY_M = (10.0, 0.0)  # a street runs here, so that this place is free in every suburb


@dataclass(frozen=True, eq=False)
class Street:
    """A centre line, and the stretch of it on the map that is not part of another street."""

    line: shapely.LineString
    on_map_m: tuple[float, float]  # where along the line that stretch begins and ends
    head: shapely.Point | None = None  # the middle of the turning circle where it ends, if it does

    def at(self, along_m: float, aside_m: float = 0.0) -> Pose:
        """The place ``along_m`` the line, ``aside_m`` to its left, and the heading there."""
        # A negative distance would count from the line's end.
        a, b = (self.line.interpolate(max(along_m + d, 0.0)) for d in (-0.5, 0.5))
        # Rounded: processors' arctan2 differ in the last bit, and by that how ground is cut.
        heading = round(float(np.arctan2(b.y - a.y, b.x - a.x)), 12)
        x_m = (a.x + b.x) / 2 + aside_m * -np.sin(heading)
        y_m = (a.y + b.y) / 2 + aside_m * np.cos(heading)
        return Pose(float(x_m), float(y_m), heading)


@dataclass(frozen=True, eq=False)
class Streets:
    """All streets and their widths."""

    lines: tuple[Street, ...]
    width_m: float
    pavement_m: float

    @property
    def half_m(self) -> float:
        """From the centre line to the lots."""
        return self.width_m / 2 + self.pavement_m

    @cached_property
    def road(self) -> shapely.Geometry:
        """What vehicles drive on."""
        return self._around(self.width_m / 2)

    @cached_property
    def kerb(self) -> shapely.Geometry:
        """The stones along the road."""
        return self.road.buffer(KERB_M).difference(self.road)

    @cached_property
    def corridor(self) -> shapely.Geometry:
        """Road, kerb and pavement."""
        return self._around(self.half_m)

    @cached_property
    def junctions(self) -> tuple[shapely.Point, ...]:
        """Where centre lines cross."""
        pairs = itertools.combinations(self.lines, 2)
        met = shapely.get_parts([a.line.intersection(b.line) for a, b in pairs])
        return tuple(p for p in met if p.geom_type == "Point")

    @cached_property
    def heads(self) -> tuple[shapely.Point, ...]:
        """The middles of turning circles."""
        return tuple(s.head for s in self.lines if s.head)

    def beside(self, street: Street, along_m: float, side: int, beyond_kerb_m: float) -> Pose:
        """A place left (1) or right (-1) of a road; a model's -y looks at it."""
        place = street.at(along_m, side * (self.width_m / 2 + beyond_kerb_m))
        return place if side > 0 else replace(place, yaw_rad=place.yaw_rad + np.pi)

    def met_m(self, street: Street) -> list[float]:
        """Where along a street its junctions are."""
        return [street.line.project(p) for p in self.junctions if street.line.distance(p) < 0.1]

    def arms(self, street: Street) -> list[tuple[float, int]]:
        """Where a street leaves its junctions: (along_m of the junction, 1 onwards or -1 back)."""
        reach, length = self.half_m + 8.0, street.line.length
        return [(c, s) for c in self.met_m(street) for s in (-1, 1) if 0 < c + s * reach < length]

    def _around(self, reach_m: float) -> shapely.Geometry:
        strips = [s.line.buffer(reach_m, cap_style="flat") for s in self.lines]
        circles = [head.buffer(reach_m + TURNING_M) for head in self.heads]
        joined = shapely.union_all([*strips, *circles])
        return joined.buffer(_CORNER_M).buffer(-_CORNER_M)


def draw_streets(spec: SceneSpec, rng: Generator) -> Streets:
    """A random pattern of gently bent streets; one passes ``START_XY_M``.

    It is drawn in a frame (t, o) along and across the long streets, the map's middle at its origin.
    """
    swap = bool(rng.random() < 0.5)  # t is y
    half_t, half_o = np.array(spec.extent_m)[:: -1 if swap else 1] / 2
    start_t, start_o = START_XY_M[::-1] if swap else START_XY_M
    spacing = spec.streets.spacing_m

    n = max(1, int(2 * half_o / max(_ROW_M, 0.85 * spacing)))
    gap = 2 * half_o / n
    places = (np.arange(n) + 0.5) * gap - half_o + rng.uniform(-0.06, 0.06, n) * gap
    slope, knee = _bend(spec, rng), rng.uniform(-0.3, 0.3) * half_t  # what long streets share
    nearest = int(np.argmin(np.abs(places - start_o)))
    on_long = bool(abs(places[nearest] - start_o) < 0.2 * gap)
    through = [(0.0, place) for place in places]
    if on_long:
        through[nearest] = (start_t, start_o)
    long = [_course(spec, rng, point, slope, knee) for point in through]

    crosses = [] if on_long else [start_t]
    for place in rng.permutation(np.arange(-half_t + 20.0, half_t - 20.0, 5.0)):
        enough = rng.random() < 0.5 if crosses else False
        if enough or len(crosses) * 1.2 * spacing > 2 * half_t:
            break
        if all(abs(place - other) > 0.75 * spacing for other in crosses):
            crosses.append(float(place) + rng.uniform(-2.0, 2.0))

    made = [_long(rng, line, half_t, [start_t, *crosses]) for line in long]
    for k, place in enumerate(crosses):
        must = start_o if k == 0 and not on_long else None
        slope, knee = _bend(spec, rng), rng.uniform(-0.3, 0.3) * half_o
        line = _course(spec, rng, (must or 0.0, place), slope, knee)
        made.append((_cross(rng, _swapped(line), long, must), False))

    turn = rng.uniform(-_TURN_RAD, _TURN_RAD)
    on_map = shapely.box(*-np.array(spec.extent_m) / 2, *np.array(spec.extent_m) / 2)
    width_m, pavement_m = spec.streets.width_m, spec.streets.pavement_m
    streets = []
    for line, dead_end in made:
        line = _swapped(line) if swap else line
        line = affinity.rotate(line, turn, origin=START_XY_M, use_radians=True)
        streets.append(_street(line, dead_end, on_map, width_m / 2 + pavement_m))
    return Streets(tuple(s for s in streets if s), width_m, pavement_m)


def _bend(spec: SceneSpec, rng: Generator) -> float:
    """The slope that a street takes on where it bends; half the streets do not."""
    return float(rng.uniform(-0.06, 0.06)) * spec.streets.bend_m if rng.random() < 0.5 else 0.0


def _course(
    spec: SceneSpec, rng: Generator, through: tuple[float, float], slope: float, knee_m: float
) -> shapely.LineString:
    """A centre line along the first axis: a wave, and a bend by ``slope`` at ``knee_m``."""
    reach = float(np.hypot(*spec.extent_m)) / 2 + 1.5 * BEYOND_M
    t = np.arange(-reach, reach + _STEP_M, _STEP_M)
    wave = 2 * np.pi / (rng.uniform(1.0, 1.5) * max(*spec.extent_m, 120.0))
    swing = spec.streets.bend_m * rng.uniform(0.3, 1.0)
    offset = swing * np.sin(wave * t + rng.uniform(0, 2 * np.pi))
    soft_m = 6.0
    offset += slope * soft_m * np.logaddexp(0.0, (t - knee_m) / soft_m)
    offset += through[1] + rng.uniform(-0.8, 0.8) - np.interp(through[0], t, offset)
    return shapely.LineString(np.column_stack([t, offset]))


def _swapped(line: shapely.LineString) -> shapely.LineString:
    """The line with its axes exchanged."""
    return shapely.transform(line, lambda xy: xy[:, ::-1])


def _long(
    rng: Generator, line: shapely.LineString, half_m: float, met_m: Sequence[float]
) -> tuple[shapely.LineString, bool]:
    """A long street as it is built, and whether it has a dead end, off all that it meets."""
    side, end = int(rng.choice([-1, 1])), half_m - rng.uniform(22.0, 40.0)
    if rng.random() < 0.6 or any(side * m > end - 26.0 for m in met_m):
        return line, False
    y = np.interp(side * end, *np.asarray(line.coords).T)
    along = line.project(shapely.Point(side * end, y))
    if side > 0:
        return ops.substring(line, 0.0, along), True
    return ops.substring(line, along, line.length).reverse(), True  # the dead end last


def _cross(
    rng: Generator,
    line: shapely.LineString,
    long: Sequence[shapely.LineString],
    keep_m: float | None,
) -> shapely.LineString:
    """A crossing street as it is built; ``keep_m`` stays on it."""
    met = sorted(line.project(line.intersection(other).centroid) for other in long)
    ends = [0.0, line.length]
    for k, side in enumerate((-1, 1)):
        if rng.random() < 0.45:
            continue
        end = met[-k] + side * 0.5  # a little over the other's centre line, so that the two cross
        if keep_m is None or side * line.interpolate(end).y >= side * keep_m + 8.0:
            ends[k] = end
    return ops.substring(line, *ends)


def _street(
    line: shapely.LineString, dead_end: bool, on_map: shapely.Geometry, half_width_m: float
) -> Street | None:
    """The street of a centre line, unless nearly all of it is off the map."""
    inside = max(
        shapely.get_parts(line.intersection(on_map)), key=lambda part: part.length, default=None
    )
    if inside is None or inside.length < _SHORTEST_M:
        return None
    start, end = (line.project(shapely.Point(c)) for c in (inside.coords[0], inside.coords[-1]))
    clear = half_width_m + 1.0  # of the street that it begins or ends at
    if start < 1e-6:
        start = clear
    if end > line.length - 1e-6:
        end = line.length - clear - (TURNING_M if dead_end else 0.0)
    head = shapely.Point(line.coords[-1]) if dead_end else None
    return Street(line, (start, end), head)
