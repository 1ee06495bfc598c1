import json
import struct
import zlib
from dataclasses import fields, replace

import answers
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vrchain.errors import ImageError, VRChainError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import nothing
from vrchain.landmarks.extraction.record import (
    LandmarkRecord,
    agree,
    decode_record,
    encode_record,
    owners,
)
from vrchain.landmarks.extraction.sift import Features
from vrchain.panorama import CameraRig
from vrchain.seeding import generator

CENTRES_M = np.array([[10.0, 0.0], [0.0, 14.0], [-9.0, 1.0]])
N = 200


def keypoints(n: int = N) -> Features:
    draws = generator(0, "keypoints")
    return Features(
        draws.uniform(-np.pi, np.pi, n), draws.uniform(-0.39, 0.39, n), draws.uniform(0, 0.2, n),
        (draws.integers(0, 16, (n, 128)) ** 2).astype(np.uint8),  # squares, as records keep them
    )  # fmt: skip


def record(n: int = N) -> LandmarkRecord:
    return answers.record(Pose(0, 0, 0), CENTRES_M, keypoints(n))


def test_a_record_comes_back_in_its_steps() -> None:
    before = record()
    after = decode_record(encode_record(before))
    assert (after.rig, after.maker) == (before.rig, before.maker)
    tolerance = {"embedding": 0.01, "box": 5e-4, "range_m": 1e-3, "range_std": 5e-4}
    for field in fields(before.proposals):
        was, now = (getattr(r.proposals, field.name) for r in (before, after))
        assert was.shape == now.shape
        assert np.allclose(was, now, rtol=0, atol=tolerance.get(field.name, 1e-4)), field.name
    off = wrap_angle_rad(after.features.bearing_rad - before.features.bearing_rad)
    assert np.abs(off).max() < 1e-4  # a hundredth of a pixel is 1.8e-5
    assert np.abs(after.features.slope - before.features.slope).max() < 1e-4
    assert (after.features.descriptors == before.features.descriptors).all()
    assert len(before.spots) > 50
    for field in fields(before.spots):
        was, now = (getattr(r.spots, field.name) for r in (before, after))
        assert np.array_equal(was, now)


def test_of_descriptors_the_rounded_roots_are_kept() -> None:
    known = record()
    coded = np.arange(len(known.features) * 128).reshape(-1, 128).astype(np.uint8)
    told = replace(known, features=replace(known.features, descriptors=coded))
    again = decode_record(encode_record(told)).features.descriptors
    assert np.abs(np.sqrt(again.astype(float)) - np.sqrt(coded)).max() <= 1.0
    assert encode_record(decode_record(encode_record(told))) == encode_record(told)


def test_last_bits_are_nothing_to_a_record() -> None:
    """What processors disagree about in float64 is gone in the bytes."""
    known = record()
    numbers = ("score", "bearing_rad", "range_m", "bearing_std_rad", "range_std", "box")
    off = {name: getattr(known.proposals, name) * (1 + 1e-12) for name in numbers}
    other = replace(known, proposals=replace(known.proposals, **off), moved=Pose(1 / 3, 0.1, 0.7))
    same = replace(known, moved=Pose(1 / 3 + 1e-12, 0.1, 0.7 - 1e-12))
    assert encode_record(other) == encode_record(same)


def test_who_extracts_again_allows_one_step_and_no_more() -> None:
    known = record()
    told, step = encode_record(known), 2.0**-15
    for steps, expected in ((0, True), (1, True), (2, False)):
        score = known.proposals.score - steps * step
        over_the_seam = known.features.bearing_rad + steps * np.pi / 2**15
        bearing = wrap_angle_rad(over_the_seam)
        for again in (
            replace(known, proposals=replace(known.proposals, score=score)),
            replace(known, features=replace(known.features, bearing_rad=bearing)),
        ):
            assert agree(told, encode_record(again)) == expected
            assert agree(encode_record(again), told) == expected
    assert agree(told, encode_record(replace(known, moved=Pose(1, 2, 3))))
    kinds = replace(known.proposals, kind=(known.proposals.kind + 1) % 5)
    for other in (replace(known, proposals=kinds), replace(known, maker="cd" * 32), record(5)):
        assert not agree(told, encode_record(other))
    with pytest.raises(ImageError):
        agree(told, told[:-1])


def test_lengths_and_products_of_looks_are_exact() -> None:
    """So that in whatever order a processor adds, two looks are as alike."""
    looks = decode_record(encode_record(record())).proposals.embedding
    assert np.abs(np.linalg.norm(looks, axis=1) - 1).max() < 0.01
    exact = looks.astype(float) @ looks.astype(float).T
    assert np.array_equal(looks @ looks.T, exact.astype(np.float32))
    assert np.array_equal(exact, exact.astype(np.float32))


def test_how_the_robot_moved_comes_back_and_changes_nothing_else() -> None:
    plain, moved = record(), Pose(3.25, -0.5, 3.1)
    told = replace(plain, moved=moved)
    assert decode_record(encode_record(plain)).moved is None
    again = decode_record(encode_record(told)).moved
    assert again is not None and (again.x_m, again.y_m) == (moved.x_m, moved.y_m)
    assert again.yaw_rad == pytest.approx(moved.yaw_rad, abs=5e-5)
    same = replace(decode_record(encode_record(told)), moved=None)
    assert encode_record(same) == encode_record(decode_record(encode_record(plain)))


@pytest.mark.parametrize(
    "moved", [[1.0, 2.0], [1.0, 2.0, 0.5, 0.0], [np.nan, 0, 0], [0, np.inf, 0], [0, 0, 9.0],
              [1e9, 0, 0], "far", {"x_m": 1}, [0, 0, None], 7]
)  # fmt: skip
def test_no_robot_moved_like_that(moved: object) -> None:
    told = encode_record(replace(record(), moved=Pose(1.0, 2.0, 0.0)))
    with pytest.raises(ImageError, match="unreadable"):
        decode_record(with_header(told, moved=moved))


def test_encoding_is_canonical() -> None:
    once = encode_record(record())
    assert encode_record(record()) == once == encode_record(decode_record(once))


def test_a_record_of_nothing() -> None:
    empty = LandmarkRecord(CameraRig(n_views=1), "0" * 64, nothing(), keypoints(0))
    after = decode_record(encode_record(empty))
    assert len(after.proposals) == len(after.features) == len(after.spots) == 0


def test_keypoints_know_the_proposal_they_lie_in() -> None:
    known = record()
    step = 2 * np.pi / answers.SHAPE[1]
    p = known.proposals
    middle = wrap_angle_rad((p.box[:, 0] + p.box[:, 1]) / 2)
    on = Features(
        np.r_[middle, middle + np.pi / 7], np.r_[(p.box[:, 2] + p.box[:, 3]) / 2, np.full(3, 0.38)],
        np.full(6, step), np.zeros((6, 128), dtype=np.uint8),
    )  # fmt: skip
    assert list(owners(known.rig, p, on)) == [0, 1, 2, -1, -1, -1]


@given(st.binary(max_size=200))
def test_other_bytes_are_refused(garbage: bytes) -> None:
    with pytest.raises(ImageError):
        decode_record(garbage)


@given(st.data())
def test_damaged_bytes_are_refused_or_decode(data: st.DataObject) -> None:
    """Only errors of our own come out, and what decodes is of the shapes it says."""
    blob = bytearray(encode_record(record(5)))
    for _ in range(data.draw(st.integers(1, 3))):
        blob[data.draw(st.integers(0, len(blob) - 1))] = data.draw(st.integers(0, 255))
    try:
        found = decode_record(bytes(blob))
    except VRChainError:
        return
    assert len(found.proposals.embedding) == len(found.proposals)


def with_header(blob: bytes, **said: object) -> bytes:
    """A record whose header says something else."""
    end = 12 + struct.unpack(">I", blob[8:12])[0]
    table = json.dumps({**json.loads(blob[12:end]), **said}).encode()
    return blob[:8] + struct.pack(">I", len(table)) + table + blob[end:]


@pytest.mark.parametrize(
    ("key", "value"),
    [("proposals", -1), ("proposals", 255), ("keypoints", 10**9), ("keypoints", 4001),
     ("embedded", 0), ("embedded", 10**30),
     ("spots", [10**6, 32]), ("spots", [0, 32]), ("spots", [-1, -32]), ("spots", [3]),
     ("rig", {"n_views": 0})],
)  # fmt: skip
def test_a_header_that_lies_is_refused(key: str, value: object) -> None:
    """A header that promises much is refused before memory is asked for."""
    with pytest.raises(ImageError, match="landmark record"):
        decode_record(with_header(encode_record(record(5)), **{key: value}))


@pytest.mark.parametrize(
    ("name", "value"),
    [("range_m", 3e38), ("range_m", -1.0), ("box", 1e30), ("bearing_rad", np.inf), ("kind", 99)],
)
def test_what_no_robot_sees_is_refused(name: str, value: float) -> None:
    """It would lead whoever plans by it out of this world."""
    known = record(5)
    told = np.array(getattr(known.proposals, name))
    told[0] = value
    proposals = replace(known.proposals, **{name: told})
    with pytest.raises(ImageError, match="landmark record: expected"):
        decode_record(encode_record(replace(known, proposals=proposals)))


@pytest.mark.parametrize("order", [[1, 0, 2, 3], [0, 1, 3, 2]])
def test_a_box_is_not_inside_out(order: list[int]) -> None:
    """Who looks for keypoints within it would look at an empty picture."""
    known = record(5)
    box = known.proposals.box[:, order]
    with pytest.raises(ImageError, match="edges are in order"):
        decode_record(encode_record(replace(known, proposals=replace(known.proposals, box=box))))


def test_a_bomb_is_not_unpacked() -> None:
    blob = encode_record(record(5))
    end = 12 + struct.unpack(">I", blob[8:12])[0]
    with pytest.raises(ImageError, match="expected"):
        decode_record(blob[:end] + zlib.compress(bytes(300_000_000), 9))
