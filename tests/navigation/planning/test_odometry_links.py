"""Odometry links: what a robot says of how it moved between its own panoramas."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from vrchain.geometry import Pose, relative
from vrchain.navigation.planning.odometry_links import links, tracks
from vrchain.navigation.settings import Published


@dataclass(frozen=True)
class Record:
    moved: Pose | None


@dataclass(frozen=True)
class Look:
    record: Record | None


STOOD = [Pose(3.0, 4.0, 1.0), Pose(9.0, 4.0, 2.0), Pose(9.0, 20.0, -3.0), Pose(-1.0, 20.0, 0.5)]


def published(
    robot: str = "R2", stood: list[Pose] = STOOD
) -> tuple[dict[str, Published], dict[str, Look]]:
    """What a robot published from where it stood, one after the other."""
    names = [f"{robot}~{k}" if k else robot for k in reversed(range(len(stood)))]
    known = {n: Published(n.encode(), i) for i, n in enumerate(names)}
    moved = [None, *(relative(a, b) for a, b in pairwise(stood))]
    return known, {n: Look(Record(m)) for n, m in zip(names, moved, strict=True)}


def test_a_track_leads_from_panorama_to_panorama() -> None:
    (track,) = tracks(*published())
    assert [name for name, _ in track] == ["R2~3", "R2~2", "R2~1", "R2"]
    for (_, told), stood in zip(track, STOOD, strict=True):
        there = relative(STOOD[0], stood)
        assert told.xy_m == pytest.approx(there.xy_m)
        assert np.cos(told.yaw_rad - there.yaw_rad) == pytest.approx(1.0)


def test_robots_have_tracks_of_their_own() -> None:
    known, looks = published("R10")
    more, shown = published("R2")
    found = tracks(known | more, looks | shown)
    assert tracks({}, {}) == []
    assert [[name for name, _ in track] for track in found] == [
        ["R10~3", "R10~2", "R10~1", "R10"], ["R2~3", "R2~2", "R2~1", "R2"],
    ]  # fmt: skip


@pytest.mark.parametrize("gap", ["gone", "untold", "no record"])
def test_where_nothing_tells_how_it_moved_another_track_begins(gap: str) -> None:
    known, looks = published()
    if gap == "gone":
        del known["R2~1"], looks["R2~1"]
    else:
        looks["R2~1"] = Look(None if gap == "no record" else Record(None))
    names = [[name for name, _ in track] for track in tracks(known, looks)]
    assert names == [["R2~3", "R2~2"], ["R2"] if gap == "gone" else ["R2~1", "R2"]]


def test_the_same_picture_twice_is_from_one_place() -> None:
    known, looks = published()
    known["R2~1"], looks["R2~1"] = known["R2~2"], looks["R2~2"]  # a ledger gives the first record
    (track,) = tracks(known, looks)
    assert track[1][1] == track[2][1]


def test_what_is_far_apart_along_the_way_is_linked_by_what_lies_between() -> None:
    far = [Pose(20.0 * k, 0.0) for k in range(6)]
    (track,) = tracks(*published(stood=far))
    found = {(a, b): moved for a, b, moved in links(track)}
    assert len(found) == 5 + 4  # next to each other, and 40 m apart
    assert found["R2~5", "R2~3"].xy_m == pytest.approx([40.0, 0.0])
    lone = tracks(*published(stood=[Pose(0, 0), Pose(300.0, 0.0)]))[0]
    assert [pair[:2] for pair in links(lone)] == [("R2~1", "R2")]
