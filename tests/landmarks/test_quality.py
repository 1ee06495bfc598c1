from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import sights
import worlds
from sights import RIG, descriptors, directions, features_of

from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import CommonLandmark, Comparison, Region
from vrchain.landmarks.quality import Verdict, co_visible, judge
from vrchain.panorama import CameraRig
from vrchain.world.model import Scene, place
from vrchain.world.truth import GroundTruth

GREY = worlds.plain((120, 120, 120))
A, B = Pose(0, 0, 0.4), Pose(1, -2, -1.5)
REGION = Region(0, (0.0, 0.0, 1.0, 1.0), 0.0, 0.1)


def street() -> Scene:
    """Two houses of one model, one of another, and a pole that is no landmark."""
    twin = worlds.box("twin 0", (10, 6), (2, 2, 3), GREY)
    surfaces = worlds.box("model", (0, 0), (2, 2, 3), GREY).surfaces
    return worlds.world(
        twin,
        place("twin 1", "box", twin.model, surfaces, Pose(10, -6), landmark=True),
        worlds.box("shed", (12, 0), (2, 2, 3), GREY),
        worlds.box("pole", (-8, 0), (1, 1, 3), GREY, landmark=False),
    )


SCENE = street()
TRUTH = GroundTruth(SCENE)
ON = {
    "twin 0": (9.0, 6.0, 1.5),
    "twin 1": (9.0, -6.0, 1.5),
    "shed": (11.0, 0.0, 1.5),
    "pole": (-7.5, 0.0, 1.5),
    "sky": (3.0, 30.0, 30.0),
    "ground": (3.0, 3.0, 0.0),
    "flag": (4.0, 3.0, 0.66),  # a robot's, if one stands there
}


def judged(
    *claims: tuple[list[str], list[str]],
    robots: tuple[dict[str, Pose], dict[str, Pose]] = ({}, {}),
) -> list[Verdict]:
    """Verdicts on claims whose keypoints lie on the named things, in A and in B."""
    features, supports = [], []
    for side, pose in ((0, A), (1, B)):
        names = [name for claim in claims for name in claim[side]]
        points = np.array([ON[n] for n in names], dtype=float)
        spread = np.array([[0, 0.02 * k, 0.01 * k] for k in range(len(names))])
        bearing, slope = directions(pose, points + spread)
        features.append(features_of(bearing, slope, descriptors(len(names))))
        ends = np.cumsum([0, *(len(claim[side]) for claim in claims)])
        supports.append([np.arange(a, b) for a, b in pairwise(ends)])
    common = tuple(
        CommonLandmark(0.9, REGION, REGION, a, b) for a, b in zip(*supports, strict=True)
    )
    return judge(Comparison(common, None), TRUTH, (A, B), tuple(features), RIG, robots)


def test_a_claim_is_right_on_one_landmark_and_on_two_only_twins_are_counted_apart() -> None:
    right, twins, models = (
        judged((["shed"] * 4, ["shed"] * 4), (["twin 0"] * 5, ["twin 1"] * 5),
               (["twin 0"] * 5, ["shed"] * 5))
    )  # fmt: skip
    assert right == Verdict("shed", "shed", True, False, False, right.quality_m)
    assert right.quality_m == pytest.approx(0, abs=1e-3)
    assert (twins.object_a, twins.object_b) == ("twin 0", "twin 1")
    assert twins.twin and not twins.right
    assert twins.quality_m == pytest.approx(12.0, abs=0.01)  # between the median points
    assert not models.right and not models.twin


@pytest.mark.parametrize("name", ["pole", "ground", "sky"])
def test_what_is_no_landmark_is_never_right(name: str) -> None:
    (verdict,) = judged(([name] * 5, [name] * 5))
    assert (verdict.object_a, verdict.object_b) == (name, name)
    assert not verdict.right and not verdict.twin
    assert np.isnan(verdict.quality_m) == (name == "sky")
    mixed = judged((["shed"] * 5, [name] * 5))[0]
    assert not mixed.right and np.isnan(mixed.quality_m) == (name == "sky")


def test_a_claim_on_a_robot_is_wrong() -> None:
    flag = (["flag"] * 3, ["flag"] * 3)
    there = {"R2": Pose(-20, 0), "R3": Pose(*ON["flag"][:2], 2.0)}
    (verdict,) = judged(flag, robots=(there, {"R3": there["R3"]}))
    assert (verdict.object_a, verdict.object_b) == ("R3", "R3")
    assert not verdict.right and not verdict.twin and verdict.quality_m < 0.2
    verdicts = judged(flag, flag, (["shed"] * 3, ["shed"] * 3), robots=(there, {}))
    assert [v.object_a for v in verdicts] == ["R3", "R3", "shed"]
    assert verdicts[0].object_b == "ground"  # it has gone by then
    assert [v.duplicate for v in verdicts] == [False, True, False]
    assert [v.right for v in verdicts] == [False, False, True]


def test_half_the_support_is_enough_and_less_is_not() -> None:
    half = ["shed"] * 2 + ["twin 0", "twin 1"]
    third = [*half, "pole", "ground"]
    for part, right in ((half, True), (third, False)):
        whole = ["shed"] * len(part)
        assert judged((part, whole))[0].right == judged((whole, part))[0].right == right


def test_a_few_points_on_the_sky_do_not_spoil_the_quality() -> None:
    (verdict,) = judged((["shed"] * 4 + ["sky"], ["shed"] * 5))
    assert verdict.right and verdict.quality_m < 0.2


def test_a_second_claim_on_one_pair_of_objects_is_a_duplicate() -> None:
    shed, twins = (["shed"] * 3, ["shed"] * 3), (["twin 0"] * 3, ["twin 1"] * 3)
    verdicts = judged(shed, twins, shed, (["twin 1"] * 3, ["twin 0"] * 3), twins, shed)
    assert [v.duplicate for v in verdicts] == [False, False, True, False, True, True]
    assert [v.right for v in verdicts] == [True, False, True, False, False, True]


def test_no_claims_no_verdicts() -> None:
    assert judge(Comparison((), None), TRUTH, (A, B), (sights.sight(A), sights.sight(B)), RIG) == []


# --- who sees what ---


def test_both_see_what_nothing_hides() -> None:
    found = co_visible(TRUTH, A, B, RIG)
    assert {SCENE.objects[i].name for i in found} == {"twin 0", "twin 1", "shed"}
    assert sorted(found) == sorted(co_visible(TRUTH, B, A, RIG))


def test_a_wall_between_hides() -> None:
    house = worlds.box("house", (10, 0), (2, 2, 2), GREY)
    screen = worlds.box("screen", (4, 0), (0.2, 6, 4), GREY, landmark=False)
    truth = GroundTruth(worlds.world(house, screen))
    hidden, clear, clear_too = Pose(0, 0), Pose(10, 8), Pose(8, 9)
    assert co_visible(truth, hidden, clear, RIG) == co_visible(truth, clear, hidden, RIG) == []
    assert co_visible(truth, clear, clear_too, RIG) == [1]


def test_each_looks_from_the_height_of_its_own_camera() -> None:
    house = worlds.box("house", (10, 0), (2, 2, 1), GREY)
    screen = worlds.box("screen", (4, 0), (0.2, 6, 1.2), GREY, landmark=False)
    truth, high = GroundTruth(worlds.world(house, screen)), replace(RIG, camera_height_m=3.0)
    low_pose, clear = Pose(0, 0), Pose(8, 5)
    assert co_visible(truth, low_pose, clear, RIG) == []
    assert co_visible(truth, low_pose, clear, (high, RIG)) == [1]
    assert co_visible(truth, clear, low_pose, (RIG, high)) == [1]
    assert co_visible(truth, clear, low_pose, (high, RIG)) == []


def test_two_sides_of_one_house_are_not_seen_in_common() -> None:
    truth = GroundTruth(worlds.world(worlds.box("house", (0, 0), (4, 4, 3), GREY)))
    south, north, corner = Pose(0, -8), Pose(0, 8), Pose(6, -8)
    assert [co_visible(truth, south, other, RIG) for other in (north, corner)] == [[], [1]]


@pytest.mark.parametrize(("overlap_m", "common"), [(0.4, []), (3.2, [1])])
def test_a_fifth_of_the_surface_is_enough(overlap_m: float, common: list[int]) -> None:
    """A partition lets each of two robots see one half of a wall, and a strip in the middle."""
    wall = worlds.box("wall", (10.1, 0), (0.2, 10, 2), GREY)
    end_m = 2 + 32 / (4 + overlap_m / 2)  # by the lines of sight from 4 m beside it
    screen = worlds.box("screen", (end_m / 2, 0), (end_m, 0.02, 6), GREY, landmark=False)
    truth = GroundTruth(worlds.world(wall, screen))
    assert co_visible(truth, Pose(2, -4), Pose(2, 4), RIG) == common


def test_a_single_camera_sees_in_common_only_what_is_ahead_of_both() -> None:
    rig = CameraRig(n_views=1, width_px=160, height_px=120)
    truth = GroundTruth(worlds.world(worlds.box("house", (8, 0), (2, 2, 2), GREY)))
    seen = [co_visible(truth, Pose(0, 0, 0), Pose(0, 1, yaw), rig) for yaw in (0, np.pi)]
    assert seen == [[1], []]
