import numpy as np
import pytest
from plains import PERCEPTION, Plain, Thing, Walker

from vrchain.geometry import Pose
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.driving.exploring import Explorer
from vrchain.navigation.settings import GaveUp, MissionConfig

POST = Plain((Thing("post", (500.0, 0.0)),))


def explored(n: int, config: MissionConfig, shut_in: bool = False) -> tuple[Pilot, list[str]]:
    """Looks, n of them, each after a stretch of exploring; and what was logged."""
    pilot, told = Pilot(Walker(POST, Pose(0.0, 0.0, 0.4), shut_in), PERCEPTION, config), []
    explorer = Explorer(pilot, lambda what, why, look=None, **values: told.append(what))
    for _ in range(n):
        pilot.look_around()
        explorer.drive_on()
    return pilot, told


def test_it_goes_where_it_has_not_looked() -> None:
    config = MissionConfig(explore_m=20.0)
    pilot, told = explored(12, config)
    looked = np.array(pilot.looked)
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
    pilot.looked.extend(np.stack(np.meshgrid(side_m, side_m), axis=-1).reshape(-1, 2))
    pilot.look_around()
    told: list[str] = []
    explorer = Explorer(pilot, lambda what, why, look=None, **values: told.append(what))
    explorer.drive_on()
    assert told == ["explore"] and np.hypot(*pilot.here.xy_m) > 5.0


def test_time_runs_out_on_the_way() -> None:
    with pytest.raises(GaveUp, match="out of time after 30 s"):
        explored(20, MissionConfig(limit_s=30.0))


def test_where_others_have_looked_it_goes_last() -> None:
    """Ahead others have looked, so it goes aside; where they looked everywhere, it goes on."""
    config = MissionConfig(explore_m=20.0)
    ahead = [np.array([20.0, y]) for y in (-20.0, 0.0, 20.0)]
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rings = [r * np.array([np.cos(a), np.sin(a)]) for r in (20.0, 40.0, 60.0, 80.0) for a in angle]
    went = {}
    for name, others in {"alone": [], "ahead": ahead, "everywhere": rings}.items():
        pilot = Pilot(Walker(POST, Pose(0.0, 0.0)), PERCEPTION, config)
        explorer = Explorer(pilot, lambda what, why, look=None, **values: None)
        pilot.look_around()
        explorer.drive_on(others)
        went[name] = pilot.here
    assert went["alone"].x_m > 8.0
    assert went["ahead"].x_m < 3.0
    assert went["everywhere"].xy_m == pytest.approx(went["alone"].xy_m)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_it_goes_where_more_stands_that_it_saw_from_afar_only(side: float) -> None:
    """Beside the way that it would take otherwise, things can be seen far off on one side."""
    things = tuple(Thing(f"{x}", (float(x), side * 30.0)) for x in (-12, 0, 12))
    pilot = Pilot(Walker(Plain(things), Pose(0.0, 0.0)), PERCEPTION, MissionConfig())
    pilot.look_around()
    assert len(pilot.standing[0]) == 3
    assert pilot.standing[0] == pytest.approx(np.array([t.xy_m for t in things]), abs=6.0)
    Explorer(pilot, lambda what, why, look=None, **values: None).drive_on()
    assert side * pilot.here.y_m > 6.0
