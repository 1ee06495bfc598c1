from collections import Counter

import pytest
import sights
from sights import RIG

from vrchain.errors import ImageError
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.sift import Features, extract
from vrchain.landmarks.matching.common import Comparison, compare
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.panorama import Panorama

POSES = {b"a": Pose(0, 0, 0.3), b"b": Pose(3, 1, -2.0), b"c": Pose(-2, 1, 3.1)}
BLOBS = {key: sights.look(pose).encode() for key, pose in POSES.items()}
RECORDS = {b"a": b"what a shows"}


class Store:
    """Counts how often it is read and looked at."""

    def __init__(self) -> None:
        self.reads: Counter[bytes] = Counter()
        self.described: list[bytes | None] = []

    def __call__(self, digest: bytes) -> bytes:
        self.reads[digest] += 1
        return BLOBS[digest]

    def look(self, panorama: bytes, landmarks: bytes | None) -> Features:
        self.described.append(landmarks)
        return extract(Panorama.decode(panorama))


def by_sift(a: Features, b: Features) -> Comparison:
    return compare(a, b, RIG)


def index_of(store: Store) -> LandmarkIndex[Features]:
    return LandmarkIndex(store, RECORDS.get, store.look, by_sift)


def same(a: Comparison, b: Comparison) -> bool:
    return [(c.score, c.a, c.b) for c in a.common] == [(c.score, c.a, c.b) for c in b.common]


def test_the_index_says_what_comparing_says() -> None:
    index = index_of(Store())
    direct = by_sift(*(extract(Panorama.decode(BLOBS[key])) for key in (b"a", b"b")))
    assert direct.common
    assert same(index.compare(b"a", b"b"), direct)
    assert same(index.compare_with(index.look(b"a"), b"b"), direct)
    assert (index.panorama(b"c").views == Panorama.decode(BLOBS[b"c"]).views).all()


def test_each_panorama_is_looked_at_once_and_each_pair_compared_once() -> None:
    store = Store()
    index = index_of(store)
    first = index.compare(b"a", b"b")
    assert index.compare(b"a", b"b") is first
    index.compare(b"b", b"a"), index.compare(b"b", b"c"), index.compare(b"a", b"c")
    index.compare_with(index.look(b"a"), b"c")
    assert store.reads == {b"a": 1, b"b": 1, b"c": 1}
    assert store.described == [b"what a shows", None, None]


def test_what_is_no_panorama_is_an_error_each_time() -> None:
    index = LandmarkIndex(lambda digest: b"junk", RECORDS.get, Store().look, by_sift)
    for _ in range(2):
        with pytest.raises(ImageError):
            index.look(b"a")
