"""The panoramas of one plan: whose word of its way is followed, and which steps of it are not."""

from itertools import pairwise

from plains import PlainIndex, street

from vrchain.geometry import Pose, placed, relative
from vrchain.navigation.planning.comparisons import Compared
from vrchain.navigation.settings import panorama_name

N_EACH = 6
HONEST = [Pose(2.0 * k, 2.0, 0.3 * k) for k in range(N_EACH)]


def told(leaps: dict[int, float], **options: object) -> Compared:
    """R2 and R3 drive side by side; R2 says that it leapt before some of its panoramas."""
    stood, moved = {}, {}
    for robot, off_m in (("R2", 0.0), ("R3", 1.5)):
        names = [panorama_name(robot, k) for k in reversed(range(N_EACH))]
        places = [Pose(p.x_m, p.y_m - off_m, p.yaw_rad) for p in HONEST]
        stood |= dict(zip(names, places, strict=True))
        for k, (a, b) in enumerate(pairwise(places), 1):
            leap_m = leaps.get(k, 0.0) if robot == "R2" else 0.0
            moved[names[k]] = placed(Pose(leap_m, 0.0), relative(a, b))
    index = PlainIndex(street(), {**stood, "R1": Pose(0.0, 0.0)}, moved)
    published = {n: p for n, p in index.published().items() if n != "R1"}
    own = [(Pose(0.0, 0.0), index.look(b"R1"))]
    found = Compared("R1", own, published, index, lambda a, b, found: 1.0, **options)
    found.compare_likely(lambda a, b: 0.0, set())
    return found


def test_every_step_of_who_is_believed_is_followed() -> None:
    found = told({})
    assert found.doubted() == {} and len(found.steps()) == 2 * (N_EACH - 1)
    assert ("R2~1", "R2") in found.steps() and ("R3~5", "R3~4") in found.steps()


def test_a_step_that_pictures_deny_is_not_followed_nor_what_lies_across() -> None:
    found = told({3: 40.0})
    assert found.doubted() == {}  # most of what it says agrees
    assert len(found.steps()) == 2 * (N_EACH - 1) - 1 and ("R2~3", "R2~2") not in found.steps()
    for a, b in (("R2~3", "R2~2"), ("R2~5", "R2")):
        assert found.poses().between(a, b) is None
    assert found.poses().between("R2~2", "R2") is not None
    assert ("R2~3", "R2~2") in found._left  # what pictures tell of it may still be asked


def test_who_was_not_believed_once_is_not_believed_again() -> None:
    found = told({}, doubted={"R3": 0.1})
    assert found.doubted() == {"R3": 0.1}
    assert {a[:2] for a, _ in found.steps()} == {"R2"}
    of_r3 = [(a, b) for a, b in found.found if a[:2] == b[:2] == "R3"]
    assert of_r3  # its pictures are compared, as anybody's
    assert all(found.poses().between(a, b) is not None for a, b in of_r3)


def test_without_reputation_everything_is_followed() -> None:
    found = told({3: 40.0}, reputation=False, doubted={"R3": 0.1})
    assert found.doubted() == {} and len(found.steps()) == 2 * (N_EACH - 1)
