"""Where streets run: centre lines that cross the map, and the polygons of what is paved.

Streets run on beyond the map's edge, so that the view along them does not end there.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from vrchain.scene.spec import SceneSpec

BEYOND_M = 100.0  # how far the ground goes on outside the map
KERB_M = 0.15
_CORNER_M = 3.0  # radius of street corners
START_XY_M = (10.0, 0.0)  # a street runs here, so that this place is free in every suburb


@dataclass(frozen=True, eq=False)
class Street:
    """A centre line from edge to edge of the ground, and the stretch of it on the map."""

    line: shapely.LineString
    on_map_m: tuple[float, float]  # where along the line the map begins and ends

    def at(self, along_m: float, aside_m: float = 0.0) -> tuple[NDArray[np.float64], float]:
        """The point ``along_m`` the line, ``aside_m`` to its left, (2,), and the heading there."""
        a, b = (self.line.interpolate(along_m + d) for d in (-0.5, 0.5))
        heading = float(np.arctan2(b.y - a.y, b.x - a.x))
        middle = np.array([(a.x + b.x) / 2, (a.y + b.y) / 2])
        return middle + aside_m * np.array([-np.sin(heading), np.cos(heading)]), heading


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
        points = []
        for i, a in enumerate(self.lines):
            for b in self.lines[i + 1 :]:
                crossing = a.line.intersection(b.line)
                points += [p for p in shapely.get_parts(crossing) if p.geom_type == "Point"]
        return tuple(points)

    def _around(self, reach_m: float) -> shapely.Geometry:
        strips = [s.line.buffer(reach_m, cap_style="flat") for s in self.lines]
        joined = shapely.union_all(strips)
        return joined.buffer(_CORNER_M).buffer(-_CORNER_M)


def draw_streets(spec: SceneSpec, rng: np.random.Generator) -> Streets:
    """Gently bent streets: along x first, then along y; one passes ``START_XY_M``."""
    size_x, size_y = spec.extent_m
    spacing, bend = spec.streets.spacing_m, spec.streets.bend_m
    lines = []
    for along, across, every, fixed in (
        (size_x, size_y, 2.5 * spacing, START_XY_M),
        (size_y, size_x, spacing, None),
    ):
        n = max(1, int(across / every))
        places = ((np.arange(n) + 0.5) / n - 0.5) * across
        if fixed:
            places -= places[np.argmin(np.abs(places))]
        else:
            places += rng.uniform(-3, 3, n)
        reach = along / 2 + BEYOND_M + 4.0  # a little over the edge, where the ground is cut
        t = np.arange(-reach, reach + 4.0, 4.0)
        for k, place in enumerate(places):
            wave = 2 * np.pi / (rng.uniform(1.0, 1.5) * max(along, 120.0))
            phase = rng.uniform(0, 2 * np.pi)
            offset = place + bend * np.sin(wave * t + phase)
            if fixed and k == np.argmin(np.abs(places)):
                offset += fixed[1] + rng.uniform(-0.8, 0.8) - np.interp(fixed[0], t, offset)
            xy = np.column_stack([t, offset] if fixed else [offset, t])
            line = shapely.LineString(xy)
            on_map = line.intersection(
                shapely.box(-size_x / 2, -size_y / 2, size_x / 2, size_y / 2)
            )
            ends = [line.project(shapely.Point(c)) for c in (on_map.coords[0], on_map.coords[-1])]
            lines.append(Street(line, (ends[0], ends[1])))
    return Streets(tuple(lines), spec.streets.width_m, spec.streets.pavement_m)
