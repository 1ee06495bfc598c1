"""What each stage says of two pictures ends in the answer that the comparison gives."""

from functools import cache

import numpy as np
import pytest

pytest.importorskip("torch", reason="proposals need torch (extra `learned`)")

from vrchain.experiments.landmarks.pairs import draw_pairs
from vrchain.landmarks.extraction.record import LandmarkRecord, examine
from vrchain.landmarks.matching.joint import compare_joint
from vrchain.landmarks.matching.photos import described, photo_landmarks
from vrchain.landmarks.matching.why import why_panoramas, why_photographs
from vrchain.panorama import CameraRig, Panorama
from vrchain.world import build_scene
from vrchain.world.render import Renderer
from vrchain.world.spec import SceneSpec

STAGES = ["proposed", "look alike", "match"]


@cache
def views() -> list[Panorama]:
    """A place, one near it, one 60 m away."""
    scene = build_scene(SceneSpec(seed=1503))
    near, far = (next(iter(draw_pairs(scene, 1, band, 3))) for band in ((4.0, 6.0), (60.0, 70.0)))
    renderer = Renderer(scene)
    return [renderer.render(pose, CameraRig()) for pose in (*near, far[1])]


@cache
def records() -> list[LandmarkRecord]:
    return [examine(panorama) for panorama in views()]


@pytest.mark.parametrize("other", [1, 2])
def test_the_stages_end_in_the_answer_of_the_comparison(other: int) -> None:
    a, b = records()[0], records()[other]
    found = compare_joint(a, b)
    told = list(why_panoramas(a, b))
    assert [stage for stage, _ in told[:3]] == STAGES and told[-1][0] == "answer"
    answer = told[-1][1]
    assert answer.startswith(f"{len(found.common)} common" if found.common else "nothing in common")
    if not found.common:
        assert found.chance is not None and f"{found.chance:.2f}" in answer


def test_what_shows_nothing_says_so() -> None:
    shape = CameraRig().n_views, CameraRig().height_px, CameraRig().width_px, 3
    black = examine(Panorama(CameraRig(), np.zeros(shape, np.uint8)))
    told = dict(why_panoramas(black, records()[0]))
    assert told["proposed"].startswith("0 landmarks in A")
    assert told["answer"].startswith("nothing in common")


def test_photographs_are_told_in_the_same_way() -> None:
    one, near, far = (panorama.views[0] for panorama in views())
    for other in (one, near, far):
        claims = photo_landmarks(one, other)
        told = dict(why_photographs(described(one), described(other)))
        assert list(told) == ["found", "match", "agree", "answer"]
        assert told["answer"].startswith("nothing") == (not claims)
