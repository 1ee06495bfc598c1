"""Records as upright cameras would have made them, where matches tell that cameras were tilted.

Relative poses, the constellation, and what is known of heights take cameras to be upright; by two
degrees of tilt near pairs are led to wrong poses that many matches obey. So the likeliest pose of
cameras that may be tilted (``tilted``) is sought first. Where it explains the matches much better
than any of upright cameras, both records are turned back. A turn of both cameras about the way
between them changes no match: of those the least is taken.
"""

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.extraction.proposer import Proposals
from vrchain.landmarks.extraction.raster import CELL_PX, ROWS, cells_at, columns_of, directions_of
from vrchain.landmarks.extraction.record import LandmarkRecord
from vrchain.landmarks.extraction.sift import Directions
from vrchain.landmarks.matching.poses import Matches, chance_right
from vrchain.landmarks.matching.tilted import Likelihood, raised
from vrchain.panorama import CameraRig

Array = NDArray[np.float64]
Seen = TypeVar("Seen", bound=Directions)

_MOST, _LEAST = 200, 12  # matched keypoints that are heard, the clearest; that tell of a tilt
_LED, _PAIRS, _GRID = 6, 300, 24  # poses led to their peaks, and what they are sought among
_CLEARLY = 3.0  # log evidence by which tilted cameras must be likelier than upright ones


def tilts(a: LandmarkRecord, b: LandmarkRecord, matches: Matches) -> tuple[Array, Array] | None:
    """The tilts of both cameras about their x and y, (2,) rad each; None: they seem upright."""
    clearest = np.argsort(matches.ratios, kind="stable")[:_MOST]
    if len(clearest) < _LEAST:
        return None
    own_a, own_b = (
        r.features.take(k[clearest]) for r, k in zip((a, b), matches.keypoints, strict=True)
    )
    growth = np.log(own_b.size_rad / own_a.size_rad)
    chance = chance_right(matches.ratios[clearest])
    likelihood = Likelihood(own_a.rays, own_b.rays, growth, chance)
    directions = own_a.bearing_rad, own_a.slope, own_b.bearing_rad, own_b.slope
    starts, _ = likelihood.starts(directions, _LED, _PAIRS, _GRID)
    poses = np.zeros((len(starts), 6))
    poses[:, :2] = starts
    straight = likelihood.peaks(poses, tilted=False)
    tilted = likelihood.peaks(straight.poses, tilted=True)
    best = int(tilted.log_evidence.argmax())
    if not tilted.log_evidence[best] >= straight.log_evidence.max() + _CLEARLY:  # NaN neither
        return None
    return tilted.poses[best, 2:4], tilted.poses[best, 4:]


def levelled(
    a: LandmarkRecord, b: LandmarkRecord, found: tuple[Array, Array] | None
) -> tuple[LandmarkRecord, LandmarkRecord]:
    """Both records as upright cameras would have made them, by the ``tilts`` found, if any."""
    return (a, b) if found is None else (_level(a, found[0]), _level(b, found[1]))


def _level(record: LandmarkRecord, tilt_rad: Array) -> LandmarkRecord:
    """Ranges stay. Every cell takes what was seen in its direction, so that there are no holes."""
    return replace(
        record,
        proposals=_proposals(record.proposals, tilt_rad, record.rig),
        features=upright(record.features, tilt_rad),
        spots=upright(record.spots, tilt_rad),
    )


def upright(seen: Seen, tilt_rad: Array) -> Seen:
    """What a camera tilted about x and y by (2,) sees, in the directions of an upright one."""
    return seen.along(raised(seen.rays, tilt_rad[None])[0])


def _proposals(own: Proposals, tilt_rad: Array, rig: CameraRig) -> Proposals:
    right, left, low, high = own.box.T
    middle = (right + left) / 2
    lower, upper = (upright(Directions(middle, slope), tilt_rad) for slope in (low, high))
    aside = (wrap_angle_rad(lower.bearing_rad + upper.bearing_rad - 2 * middle)) / 2
    grid = np.full(ROWS // CELL_PX * (columns_of(rig) // CELL_PX), -1)
    grid[own.cell] = own.owner
    every = Directions(*directions_of(np.arange(len(grid)), rig))
    was = upright(every, -tilt_rad)
    cell, inside = cells_at(was.bearing_rad, was.slope, rig)
    owner = np.where(inside, grid[cell], -1)
    return replace(
        own,
        box=np.column_stack([right + aside, left + aside, lower.slope, upper.slope]),
        bearing_rad=wrap_angle_rad(own.bearing_rad + aside),
        cell=np.flatnonzero(owner >= 0),
        owner=owner[owner >= 0],
    )
