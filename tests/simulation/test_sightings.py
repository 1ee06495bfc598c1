"""Who sees what, and what two have in common, in a small world whose answer is known."""

import pytest
from worlds import RED, SMALL_RIG, blotches, box, plain, world

from vrchain.geometry import Pose
from vrchain.simulation.sightings import Sightings, sightings_table, team_sightings
from vrchain.world.model import Scene

ROBOTS = {"R1": Pose(-8.0, 0.0), "R2": Pose(8.0, 0.0, 2.0), "R3": Pose(8.0, 2.0)}


@pytest.fixture(scope="module")
def divided() -> Scene:
    """A wall between R1 and the others; a tower beyond its end that all see."""
    return world(
        box("wall", (0.0, 0.0), (0.3, 24.0, 2.5), plain((120, 120, 120))),
        box("tower", (0.0, 17.0), (2.0, 2.0, 5.0), blotches("tower")),
        box("west", (-12.0, 3.0), (1.0, 1.0, 1.5), blotches("west")),
        box("east", (13.0, -3.0), (1.0, 1.0, 1.5), blotches("east")),
        box("stone", (-8.0, -6.0), (2.0, 2.0, 1.0), plain(RED), landmark=False),
    )


def test_what_each_sees_and_what_two_share(divided: Scene) -> None:
    found = team_sightings(divided, ROBOTS, SMALL_RIG)
    assert found.visible["R1"] == ("wall", "tower", "west")
    assert found.visible["R2"] == found.visible["R3"] == ("wall", "tower", "east")
    # The wall is seen from both sides, which have no point in common.
    assert found.common[("R1", "R2")] == ("tower",)
    assert found.common[("R2", "R3")] == ("wall", "tower", "east")
    assert found.others("R1") == ["wall", "west"]
    assert found.others("R2") == []


def test_labels_name_the_pair_and_tell_several_apart() -> None:
    common = {("R1", "R2"): ("a",), ("R2", "R3"): ("a", "b", "c")}
    labels = Sightings({}, common).labels()
    assert labels == {"a": "L12", "b": "L23b", "c": "L23c"}
    many = {("R1", "R12"): tuple(map(str, range(30))), ("R11", "R2"): ("x",)}
    found = Sightings({}, many).labels()
    assert [found[k] for k in ("0", "25", "26", "29", "x")] == [
        "L1-12a", "L1-12z", "L1-12aa", "L1-12ad", "L11-2",
    ]  # fmt: skip
    assert len(set(found.values())) == 31


def test_the_table_has_a_row_for_each_robot_and_landmark(divided: Scene) -> None:
    found = team_sightings(divided, ROBOTS, SMALL_RIG)
    table = sightings_table(divided, ROBOTS, found)
    assert len(table) == 9
    tower = table[(table.robot == "R1") & (table.landmark == "tower")].iloc[0]
    assert (tower.landmark_x_m, tower.landmark_y_m) == (0.0, 17.0)
    assert tower.in_common_with == "R2 R3" and tower.label == "L12"
    west = table[table.landmark == "west"].iloc[0]
    assert (west.in_common_with, west.label) == ("", "")


def test_without_anything_in_common_there_is_no_pair(divided: Scene) -> None:
    robots = {"R1": ROBOTS["R1"], "R2": Pose(8.0, -11.0)}
    apart = Scene("apart", divided.extent_m, tuple(o for o in divided.objects if o.name != "tower"))
    assert team_sightings(apart, robots, SMALL_RIG).common == {}
