from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from plains import PERCEPTION, Plain, Thing, Walker

from vrchain.geometry import Pose
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.driving.exploring import Explorer, Looked
from vrchain.navigation.perception import Look
from vrchain.navigation.settings import GaveUp, MissionConfig


def everything(look: Look) -> NDArray[np.float64]:
    return np.full(len(look.proposals), 0.01)


def silent(what: str, why: str, look: int | None = None, **values: object) -> None:
    """Takes nothing down."""


def looked_at(*places: tuple[float, float]) -> list[Looked]:
    """From where somebody has looked, and saw nothing."""
    empty = POST.look(Pose(0.0, 0.0))
    return [(Pose(float(x), float(y)), empty) for x, y in places]


POST = Plain((Thing("post", (500.0, 0.0)),))


def explored(n: int, config: MissionConfig, shut_in: bool = False) -> tuple[Pilot, list[str]]:
    """Looks, n of them, each after a stretch of exploring; and what was logged."""
    pilot, told = Pilot(Walker(POST, Pose(0.0, 0.0, 0.4), shut_in), PERCEPTION, config), []
    explorer = Explorer(pilot, everything, lambda what, why, look=None, **values: told.append(what))
    for _ in range(n):
        pilot.look_around()
        explorer.drive_on()
    return pilot, told


def test_it_goes_where_it_has_not_looked() -> None:
    config = MissionConfig(explore_m=20.0)
    pilot, told = explored(12, config)
    looked = np.array([pose.xy_m for pose, _ in pilot.looked])
    assert told and set(told) == {"explore"}
    steps_m = np.hypot(*np.diff(looked, axis=0).T)
    assert steps_m.max() <= config.search_every_m + 1.5
    apart_m = np.hypot(*(looked[:, None] - looked[:-3]).transpose(2, 0, 1))
    late = [apart_m[k, : k - 3].min() for k in range(4, len(looked))]
    assert min(late) > 15.0  # it does not come back to where it was


def test_shut_in_there_is_nowhere_left_to_look() -> None:
    with pytest.raises(GaveUp, match="nowhere left to look"):
        explored(200, MissionConfig(limit_s=1e6), shut_in=True)


def test_who_has_looked_everywhere_looks_everywhere_anew() -> None:
    pilot = Pilot(Walker(POST, Pose(0.0, 0.0)), PERCEPTION, MissionConfig(explore_m=40.0))
    side_m = np.arange(-80.0, 80.1, 4.0)
    pilot.looked.extend(looked_at(*product(side_m, side_m)))
    pilot.look_around()
    told: list[str] = []
    explorer = Explorer(pilot, everything, lambda what, why, look=None, **values: told.append(what))
    explorer._unreachable = [np.array(xy_m) for xy_m in product(side_m, side_m)]
    explorer.drive_on()
    assert told == ["explore"] and np.hypot(*pilot.here.xy_m) > 5.0
    assert explorer._unreachable == []  # who stood in the way may be gone


def test_time_runs_out_on_the_way() -> None:
    with pytest.raises(GaveUp, match="out of time after 30 s"):
        explored(20, MissionConfig(limit_s=30.0))


def test_where_others_have_looked_it_goes_last() -> None:
    """Ahead others have looked, so it goes aside; where they looked everywhere, it goes on."""
    config = MissionConfig(explore_m=20.0)
    ahead = [(20.0, y) for y in (-20.0, 0.0, 20.0)]
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rings = [(r * np.cos(a), r * np.sin(a)) for r in (20.0, 40.0, 60.0, 80.0) for a in angle]
    went = {}
    for name, others in {"alone": [], "ahead": ahead, "everywhere": rings}.items():
        pilot = Pilot(Walker(POST, Pose(0.0, 0.0)), PERCEPTION, config)
        explorer = Explorer(pilot, everything, silent)
        pilot.look_around()
        explorer.drive_on(looked_at(*others))
        went[name] = pilot.here
    assert went["alone"].x_m > 8.0
    assert went["ahead"].x_m < 3.0
    assert went["everywhere"].xy_m == pytest.approx(went["alone"].xy_m)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_it_goes_to_see_what_was_seen_from_afar_only(side: float) -> None:
    """By itself, or by another who passed in the distance; not what cannot be the goal."""
    things = Plain(tuple(Thing(f"{x}", (float(x), side * 35.0)) for x in (-12, 0, 12)))
    other = Pose(0.0, side * 75.0)
    seen = [(other, things.look(other))]
    for plain, others, promise, goes in (
        (things, [], everything, True),
        (POST, seen, everything, True),
        (things, seen, lambda look: 0 * everything(look), False),
    ):
        pilot = Pilot(Walker(plain, Pose(0.0, 0.0)), PERCEPTION, MissionConfig())
        pilot.look_around()
        explorer = Explorer(pilot, promise, silent)
        if plain is things and promise is everything:
            *_, stands = explorer._things(*pilot.looked[0])
            assert stands == pytest.approx(np.array([t.xy_m for t in things.things]), abs=6.0)
        explorer.drive_on(others)
        assert (side * pilot.here.y_m > 6.0) is goes


def test_what_somebody_has_seen_from_near_it_does_not_go_to_see() -> None:
    things = Plain((Thing("near others", (0.0, 35.0)), Thing("far", (0.0, -45.0))))
    pilot = Pilot(Walker(things, Pose(0.0, 0.0)), PERCEPTION, MissionConfig())
    pilot.look_around()
    Explorer(pilot, everything, silent).drive_on(looked_at((0.0, 45.0)))
    assert pilot.here.y_m < -6.0


@pytest.mark.parametrize(("chance", "goes"), [(0.3, True), (0.1, False)])
def test_what_looks_like_the_goal_it_sees_from_another_side(chance: float, goes: bool) -> None:
    """Before it goes where nobody has been; not the same side again, nor what looks less so."""
    house = Plain((Thing("house", (0.0, 14.0)),))
    for looked, new in (((0.0, 2.0), goes), ((0.0, 27.0), False)):
        pilot = Pilot(Walker(house, Pose(0.0, 0.0)), PERCEPTION, MissionConfig())
        pilot.look_around()
        explorer = Explorer(pilot, lambda look: np.full(len(look.proposals), chance), silent)
        sides = [looked, (13.0, 14.0), (-13.0, 14.0)]
        explorer.drive_on(looked_at(*sides))
        assert explorer._target is not None
        beside_m = float(np.hypot(*(explorer._target - (0.0, 14.0))))
        assert (beside_m < 12.0) is new


def test_it_never_stands_still() -> None:
    """Though more shows 3 m from where it has just looked: of the house behind, 18 m from there."""
    houses = Plain((Thing("house", (0.0, 14.0)), Thing("behind", (0.0, 41.5))))
    pilot = Pilot(Walker(houses, Pose(0.0, 0.0)), PERCEPTION, MissionConfig())
    explorer = Explorer(pilot, lambda look: np.full(len(look.proposals), 0.3), silent)
    for _ in range(20):
        pilot.look_around()
        stood = pilot.here
        explorer.drive_on()
        assert pilot.here != stood


def test_what_cannot_be_got_to_is_left() -> None:
    """Shut in, it tries another place each time."""
    things = Plain((Thing("ahead", (40.0, 0.0)), Thing("behind", (-55.0, 0.0))))
    pilot = Pilot(Walker(things, Pose(0.0, 0.0), shut_in=True), PERCEPTION, MissionConfig())
    explorer, missed = Explorer(pilot, everything, silent), set[tuple[float, float]]()
    for _ in range(3):
        pilot.look_around()
        explorer.drive_on()
        missed.add(tuple(np.round(explorer._unreachable[-1])))
    assert len(missed) == 3
