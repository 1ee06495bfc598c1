"""A made-up thing by pictures, described as a network would that is never wrong."""

from dataclasses import replace
from functools import cache

import answers
import numpy as np

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import nothing
from vrchain.landmarks.extraction.raster import CELL_PX, cell_slopes, columns_of
from vrchain.landmarks.extraction.record import LandmarkRecord
from vrchain.landmarks.extraction.sift import NO_FEATURES
from vrchain.landmarks.matching.calibration import Calibration
from vrchain.landmarks.retrieval.query import query_of, subject
from vrchain.landmarks.retrieval.template import LOWEST_SLOPE

CENTRES_M = np.array([[9.0, 0.0], [0.0, 9.0], [-8.0, 1.0], [4.0, -10.0]])
HERE = Pose(1.0, -1.0, 2.0)
CALIBRATION = Calibration(10.0, 0.5, {})


@cache
def record(pose: Pose) -> LandmarkRecord:
    return answers.record(pose, CENTRES_M)


def towards(thing: int, range_m: float) -> Pose:
    """A pose from which a picture is framed on a thing."""
    away = CENTRES_M[thing] / np.hypot(*CENTRES_M[thing])
    x_m, y_m = CENTRES_M[thing] - range_m * away
    return Pose(float(x_m), float(y_m), float(np.arctan2(away[1], away[0])))


def test_a_picture_is_framed_on_what_is_in_its_middle() -> None:
    for thing in range(len(CENTRES_M)):
        picture = record(towards(thing, 6.0))
        k = subject(picture)
        assert k is not None and abs(picture.proposals.bearing_rad[k]) < 0.1
        assert abs(picture.proposals.range_m[k] - 6.0) < 1.0


def test_a_picture_is_not_framed_on_the_lawn_before_it() -> None:
    picture = record(towards(0, 6.0))
    k = subject(picture)
    assert k is not None
    p = picture.proposals
    columns = columns_of(answers.RIG) // CELL_PX
    low = np.flatnonzero(cell_slopes() < LOWEST_SLOPE)
    lawn = (low[:, None] * columns + np.arange(columns)).ravel()
    assert len(lawn) > (p.owner == k).sum()
    both = replace(
        p.take([*range(len(p)), k]),
        box=np.vstack([p.box, [-0.8, 0.8, -0.4, 0.2]]),
        cell=np.concatenate([p.cell, lawn]),
        owner=np.concatenate([p.owner, np.full(len(lawn), len(p))]),
    )
    assert subject(replace(picture, proposals=both)) == k


def own_of(thing: int) -> int:
    """The proposal that shows a thing from ``HERE``."""
    bearing_rad = HERE.bearing_to_rad(CENTRES_M[thing])
    return int(np.abs(wrap_angle_rad(record(HERE).proposals.bearing_rad - bearing_rad)).argmin())


def test_what_is_sought_looks_more_like_itself_than_all_else_does() -> None:
    here = record(HERE)
    for thing in range(len(CENTRES_M)):
        what = query_of([record(towards(thing, r)) for r in (5.0, 7.0)])
        p, own = here.proposals, own_of(thing)
        looks, alike = what.appearance(p.embedding, CALIBRATION), what.alike(p, here.spots)
        assert looks.argmax() == own == alike.argmax()
        assert looks[own] > 0 and 0.8 < alike[own] <= 1.01
        assert np.delete(alike, own).max() < 0.8 * alike[own]


def test_spots_at_another_height_are_others() -> None:
    what = query_of([record(towards(0, 6.0))])
    p = record(towards(0, 6.0))
    k = subject(p)
    assert k is not None
    far = np.where(np.arange(len(p.proposals)) == k, 20.0, 1.0) * p.proposals.range_m
    moved = replace(p.proposals, range_m=far)
    assert what.alike(moved, p.spots)[k] < 0.8 * what.alike(p.proposals, p.spots)[k]


def test_where_there_is_nothing_nothing_is_sought_or_found() -> None:
    bare = LandmarkRecord(answers.RIG, "m", nothing(), NO_FEATURES)
    assert subject(bare) is None
    what, other = query_of([bare]), record(towards(0, 6.0))
    assert what.pictures == () and query_of([]).pictures == ()
    assert (what.appearance(other.proposals.embedding, CALIBRATION) == -np.inf).all()
    assert (what.alike(other.proposals, other.spots) == 0).all()
    assert len(query_of([other]).alike(bare.proposals, bare.spots)) == 0


def test_what_is_seen_from_other_sides_too_looks_no_less_like_itself() -> None:
    here = record(HERE)
    p = here.proposals
    for thing in range(len(CENTRES_M)):
        what = query_of([record(towards(thing, 7.0))])
        own = own_of(thing)
        wider = what.also([(here, own)])
        assert wider.pictures == what.pictures
        assert len(wider.spots) == len(what.spots) + int((here.spots.owner == own).sum())
        one, other = (
            np.r_[q.appearance(p.embedding, CALIBRATION), q.alike(p, here.spots)]
            for q in (what, wider)
        )
        assert (other >= one - 1e-5).all()
        assert wider.alike(p, here.spots)[own] > 0.99
