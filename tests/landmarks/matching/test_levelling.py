"""Panoramas of tilted cameras: levelled by their matches, claimed where they were seen."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

pytest.importorskip("torch", reason="proposals need torch (extra `learned`)")

from vrchain.experiments.landmarks.degradations import tilted
from vrchain.experiments.landmarks.pairs import draw_pairs
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.record import LandmarkRecord, examine, owners
from vrchain.landmarks.extraction.sift import NO_FEATURES
from vrchain.landmarks.matching.joint import compare_joint
from vrchain.landmarks.matching.levelling import levelled, tilts
from vrchain.landmarks.matching.poses import matches_of
from vrchain.landmarks.matching.why import why_panoramas
from vrchain.landmarks.quality import pose_errors_deg
from vrchain.panorama import CameraRig, Panorama
from vrchain.world import Scene, build_scene
from vrchain.world.render import Renderer
from vrchain.world.spec import SceneSpec

RIG = CameraRig()
TILT_DEG = 4.0
AXES_RAD = 0.5, -2.0  # about which the two are tilted


@cache
def suburb() -> Scene:
    return build_scene(SceneSpec(seed=1502))


@cache
def pair() -> tuple[tuple[Pose, Pose], tuple[Panorama, Panorama]]:
    (poses,) = draw_pairs(suburb(), 1, (5.0, 6.0), 3)
    renderer = Renderer(suburb())
    return poses, (renderer.render(poses[0], RIG), renderer.render(poses[1], RIG))


@cache
def records(tilt_deg: float) -> tuple[LandmarkRecord, LandmarkRecord]:
    a, b = (
        examine(tilted(p, np.radians(tilt_deg), axis) if tilt_deg else p)
        for p, axis in zip(pair()[1], AXES_RAD, strict=True)
    )
    return a, b


def test_upright_cameras_stay_as_they_are() -> None:
    a, b = records(0)
    matches = matches_of(a, b, True, True)
    assert tilts(a, b, matches) is None
    assert levelled(a, b, tilts(a, b, matches)) == (a, b)


def test_what_tilted_cameras_see_is_claimed_as_if_they_were_upright() -> None:
    upright, found = compare_joint(*records(0)), compare_joint(*records(TILT_DEG))
    assert found.geometry is not None and found.chance is not None and found.chance > 0.9
    assert max(pose_errors_deg(found.geometry, *pair()[0])) < 1.5
    assert len(found.common) > 0.6 * len(upright.common) > 5
    for claim in found.common:  # where the tilted cameras saw it, not where upright ones would
        seen = records(TILT_DEG)[0].features.take(claim.support_a)
        assert claim.a.bearing_rad is not None and claim.a.angular_size_rad is not None
        inside = seen.near(claim.a.bearing_rad, claim.a.angular_size_rad / 2 + 0.03)
        assert len(inside) == len(seen)


def test_levelled_records_are_those_of_upright_cameras() -> None:
    a, b = records(TILT_DEG)
    matches = matches_of(a, b, True, True)
    level, other = levelled(a, b, tilts(a, b, matches))
    assert tilts(level, other, matches) is None
    kept = owners(level.rig, level.proposals, level.features)
    assert (kept == owners(a.rig, a.proposals, a.features)).mean() > 0.9
    assert len(level.proposals.cell) == pytest.approx(len(a.proposals.cell), rel=0.1)
    lost = set(a.proposals.owner) - set(level.proposals.owner)  # the smallest, and at the edge
    assert len(lost) < 0.05 * len(a.proposals)


def test_why_tells_the_tilt() -> None:
    told = dict(why_panoramas(*records(TILT_DEG)))
    assert "levelled" in told["tilt"]
    assert "tilt" not in dict(why_panoramas(*records(0)))


def test_too_few_matches_tell_of_no_tilt() -> None:
    a, b = records(TILT_DEG)
    for bare in (replace(a, features=NO_FEATURES), replace(a, features=a.features.take([0, 1]))):
        matches = matches_of(bare, b, True, True)
        assert levelled(bare, b, tilts(bare, b, matches)) == (bare, b)
