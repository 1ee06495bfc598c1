"""Two panoramas of a real suburb, joined with the shipped weights; and what cannot be joined."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from sights import features_of

pytest.importorskip("torch", reason="proposals need torch (extra `learned`)")

from vrchain.errors import ImageError
from vrchain.experiments.landmarks.pairs import draw_pairs
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.raster import CELL_PX, cell_bearings_rad, columns_of
from vrchain.landmarks.extraction.record import LandmarkRecord, encode_record, examine
from vrchain.landmarks.matching import claims
from vrchain.landmarks.matching.claims import distinct
from vrchain.landmarks.matching.joint import JointConfig, compare_joint
from vrchain.landmarks.quality import judge
from vrchain.landmarks.retrieval import gallery
from vrchain.landmarks.retrieval.gallery import (
    Seen,
    gallery_of,
    named,
    record_from,
    who_sees,
)
from vrchain.landmarks.retrieval.query import query_of, subject
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator
from vrchain.world import Scene, build_scene
from vrchain.world.render import Renderer
from vrchain.world.spec import SceneSpec
from vrchain.world.truth import GroundTruth

RIG = CameraRig()


@cache
def suburb() -> Scene:
    return build_scene(SceneSpec(seed=1501))


@cache
def pair() -> tuple[tuple[Pose, Pose], tuple[Panorama, Panorama]]:
    (poses,) = draw_pairs(suburb(), 1, (5.0, 6.0), 7)
    renderer = Renderer(suburb())
    return poses, (renderer.render(poses[0], RIG), renderer.render(poses[1], RIG))


@cache
def records() -> tuple[LandmarkRecord, LandmarkRecord]:
    a, b = pair()[1]
    return examine(a), examine(b)


@cache
def bare(kind: str) -> LandmarkRecord:
    """A panorama in which there is nothing to find."""
    shape = (RIG.n_views, RIG.height_px, RIG.width_px, 3)
    views = {
        "black": np.zeros(shape, np.uint8),
        "grey": np.full(shape, 128, np.uint8),
        "noise": generator(0, "noise").integers(0, 256, shape).astype(np.uint8),
        "other noise": generator(1, "noise").integers(0, 256, shape).astype(np.uint8),
    }[kind]
    return examine(Panorama(RIG, views))


@pytest.mark.parametrize(
    ("sift", "spots", "within_deg"),
    [(True, True, 1.0), (True, False, 1.0), (False, True, 3.0), (False, False, 12.0)],
)
def test_two_robots_agree_on_what_they_see_and_where_they_stand(
    sift: bool, spots: bool, within_deg: float
) -> None:
    (a, b), _ = pair()
    config = JointConfig(sift=sift, spots=spots, min_score=0.6)
    found = compare_joint(*records(), config)
    assert found.geometry is not None
    direction = wrap_angle_rad(found.geometry.direction_rad - a.bearing_to_rad(b.xy_m))
    heading = wrap_angle_rad(found.geometry.heading_rad - (b.yaw_rad - a.yaw_rad))
    assert abs(direction) < np.radians(within_deg) and abs(heading) < np.radians(4)
    scores = [c.score for c in found.common]
    assert scores == sorted(scores, reverse=True)
    assert config.min_score <= scores[-1] <= scores[0] <= 1
    features = records()[0].features, records()[1].features
    verdicts = judge(found, GroundTruth(suburb()), (a, b), features, RIG)
    assert len(verdicts) >= 10 and np.mean([v.right for v in verdicts]) > config.min_score
    assert verdicts[0].right


def test_what_no_camera_saw_is_never_claimed() -> None:
    """Two cameras that look ahead, or ahead and back, each robot's facing its own way."""
    (a, b), panoramas = pair()
    cameras = ((0, 1), (5, 6)), ((2, 6), (0, 4))
    looks = [[holed(p, views) for p, views in zip(panoramas, own, strict=True)] for own in cameras]
    claimed, right = [], []
    for one, _ in looks:
        for _, other in looks:
            found = compare_joint(one, other)
            verdicts = judge(
                found, GroundTruth(suburb()), (a, b), (one.features, other.features), RIG
            )
            right += [v.right for v in verdicts]
            assert not verdicts or verdicts[0].right
            claimed.append(len(found.common))
            if found.relative_pose is not None:
                off = found.relative_pose.direction_rad - a.bearing_to_rad(b.xy_m)
                assert abs(wrap_angle_rad(off)) < np.radians(15)
    assert claimed[0] and claimed[3] and np.mean(right) > 0.8


def holed(panorama: Panorama, views: tuple[int, ...]) -> LandmarkRecord:
    """Only what some views see; the others are black, and masked."""
    seen = np.zeros(panorama.views.shape[:3], bool)
    seen[list(views)] = True
    return examine(Panorama(RIG, panorama.views * seen[..., None], seen))


def test_panoramas_that_were_hardly_joined_rightly_have_nothing_in_common() -> None:
    sure, unsure = (compare_joint(*records(), JointConfig(min_joined=p)) for p in (0.3, 1.0))
    assert sure.common and not unsure.common
    assert unsure.geometry is not None and unsure.relative_pose is None
    assert sure.relative_pose is sure.geometry and sure.chance == unsure.chance
    assert sure.chance is not None and 0.3 <= sure.chance < 1


def test_no_landmark_is_claimed_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = records()
    pairs = np.stack([np.arange(4)] * 2, axis=1)
    score = np.array([0.6, 0.9, 0.8, 0.7])
    whole = replace(
        a, proposals=replace(a.proposals.take([0, 0, 0, 1]), box=a.proposals.box[[0, 0, 0, 1]])
    )
    apart = replace(b, proposals=b.proposals.take(np.arange(4)))
    monkeypatch.setattr(claims, "_SAME_BOX", 0.999)
    assert distinct(whole, apart, pairs, score) == [1, 3]


def test_a_view_that_is_missing_holds_no_landmark() -> None:
    views = pair()[1][0].views.copy()
    views[2] = 0
    found = examine(Panorama(RIG, views)).proposals
    column = found.cell % (columns_of(RIG) // CELL_PX)
    off = wrap_angle_rad(cell_bearings_rad(RIG)[column] - RIG.azimuths_rad[2])
    assert len(found) > 10 and (np.abs(off) > np.radians(15)).all()


@pytest.mark.parametrize("kind", ["black", "grey", "noise"])
def test_where_nothing_is_to_be_seen_nothing_is_claimed(kind: str) -> None:
    assert kind == "noise" or len(bare(kind).proposals) == 0
    for other in (bare("black"), bare("grey"), bare("other noise"), *records()):
        assert not compare_joint(bare(kind), other).common
        assert not compare_joint(other, bare(kind)).common


def test_what_cannot_be_compared_is_said() -> None:
    a, b = records()
    others = {
        "one rig": replace(b, rig=CameraRig(n_views=6)),
        "one weights": replace(b, maker="ab"),
    }
    for complaint, other in others.items():
        with pytest.raises(ImageError, match=complaint):
            compare_joint(a, other)


def test_ten_thousand_keypoints_alike_on_a_fence() -> None:
    a, b = records()
    n = 10_000
    coded = np.tile(a.features.descriptors[:1], (n, 1))
    fence = features_of(np.linspace(-1, 1, n), np.full(n, 0.05), coded)
    claims = compare_joint(replace(a, features=fence), replace(b, features=fence)).common
    assert all(len(c.support_a) < 100 for c in claims)


def test_a_published_record_is_used_again_if_it_fits() -> None:
    panorama, own = pair()[1][0].encode(), records()[0]
    stored = record_from(panorama, encode_record(own))
    assert len(stored.proposals) == len(own.proposals) and stored.maker == own.maker
    marked = replace(
        own, proposals=own.proposals.take([0, 1]), spots=own.spots.take(own.spots.owner < 2)
    )
    assert len(record_from(panorama, encode_record(marked)).proposals) == 2
    elsewhere = encode_record(replace(marked, maker="ab" * 32))
    looks, spots = marked.proposals.embedding[:, :8], marked.spots.descriptors[:, :7]
    narrow = replace(marked, proposals=replace(marked.proposals, embedding=looks))
    few = replace(marked, spots=replace(marked.spots, descriptors=spots))
    for unfit in (None, b"damaged", elsewhere, encode_record(narrow), encode_record(few)):
        again = record_from(panorama, unfit)
        assert again.maker == own.maker and len(again.proposals) > 2


def test_others_are_named_once_one_is_believed() -> None:
    def seen(key: str, belief: float) -> Seen[str]:
        found = Seen(key, 0, 15.0, 0.0, 0.0, None, None)
        return replace(found, appearance=(belief - found.belief) / 1.66)

    a, b, c = seen("a", 0.1), seen("b", -2.4), seen("c", -2.6)
    assert named([a, b, c]) == ["a", "b"]
    assert named([b, c]) == named([]) == []


def test_who_sees_what_a_picture_shows_and_what_surely_does_is_sought_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With pictures that look like half of it, by what the surest panorama shows of the rest."""
    a, b = records()
    picture = examine(Panorama(replace(RIG, n_views=1), pair()[1][0].views[:1]))
    assert subject(picture) is not None
    what, panoramas = query_of([picture]), gallery_of({"black": bare("black"), "a": a, "b": b})
    first, second, *_ = who_sees(what, panoramas)
    assert first.key == "a" and first.belief > max(0.0, second.belief)
    assert first.sighting is not None and first.spotted is not None
    assert first.sighting.n_matches > 20
    wider = {s.key: s for s in who_sees(what, panoramas)}
    monkeypatch.setattr(gallery, "_MORE_SIDES", 0)
    alone = {s.key: s for s in who_sees(what, panoramas)}
    assert alone["a"].belief > 0 and wider["a"].alike > alone["a"].alike + 0.05
    assert wider["b"].alike > alone["b"].alike
    assert who_sees(query_of([bare("black")]), gallery_of({"a": a})) == []
