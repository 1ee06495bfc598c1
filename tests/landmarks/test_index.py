from collections import Counter

import numpy as np
import pytest
import sights
from sights import RIG

from vrchain.errors import ImageError
from vrchain.geometry import Pose
from vrchain.landmarks.common import Comparison, MatchConfig, compare
from vrchain.landmarks.index import LandmarkIndex
from vrchain.landmarks.sift import extract
from vrchain.panorama import Panorama

POSES = {b"a": Pose(0, 0, 0.3), b"b": Pose(3, 1, -2.0), b"c": Pose(-2, 1, 3.1)}
BLOBS = {key: sights.look(pose).encode() for key, pose in POSES.items()}


class Store:
    """Counts how often it is read."""

    def __init__(self) -> None:
        self.reads: Counter[bytes] = Counter()

    def __call__(self, digest: bytes) -> bytes:
        self.reads[digest] += 1
        return BLOBS[digest]


def same(a: Comparison, b: Comparison) -> bool:
    return [(c.score, c.a, c.b) for c in a.common] == [(c.score, c.a, c.b) for c in b.common]


def test_the_index_says_what_comparing_says() -> None:
    index = LandmarkIndex(Store())
    panoramas = {key: Panorama.decode(blob) for key, blob in BLOBS.items()}
    direct = compare(extract(panoramas[b"a"]), extract(panoramas[b"b"]), RIG)
    assert direct.common
    assert same(index.compare(b"a", b"b"), direct)
    current = extract(panoramas[b"a"])
    assert same(index.compare_with(current, RIG, b"b"), direct)
    assert np.array_equal(index.features(b"a").descriptors, current.descriptors)
    assert np.array_equal(index.panorama(b"c").views, panoramas[b"c"].views)


def test_each_panorama_is_examined_once_and_each_pair_compared_once() -> None:
    store = Store()
    index = LandmarkIndex(store)
    first = index.compare(b"a", b"b")
    assert index.compare(b"a", b"b") is first
    index.compare(b"b", b"a"), index.compare(b"b", b"c"), index.compare(b"a", b"c")
    index.compare_with(index.features(b"a"), RIG, b"c")
    assert store.reads == {b"a": 1, b"b": 1, b"c": 1}


def test_a_configuration_is_kept() -> None:
    strict = LandmarkIndex(Store(), MatchConfig(min_score=0.75))
    found = strict.compare(b"a", b"b").common
    assert found and all(c.score >= 0.75 for c in found)
    assert len(found) < len(LandmarkIndex(Store()).compare(b"a", b"b").common)


def test_what_is_no_panorama_is_refused_every_time_and_spoils_nothing() -> None:
    blobs = {**BLOBS, b"text": b"hello", b"cut": BLOBS[b"a"][:500], b"none": b""}
    index = LandmarkIndex(blobs.__getitem__)
    for bad in (b"text", b"cut", b"none"):
        for _ in range(2):
            with pytest.raises(ImageError):
                index.compare(b"a", bad)
            with pytest.raises(ImageError):
                index.features(bad)
    assert index.compare(b"a", b"b").common


def test_an_error_of_the_store_comes_through() -> None:
    with pytest.raises(KeyError):
        LandmarkIndex(Store()).features(b"unknown")
