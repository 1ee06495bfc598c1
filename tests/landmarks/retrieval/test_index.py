import pytest
import sights
from sights import RIG

from vrchain.errors import ImageError
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.sift import Features, extract
from vrchain.landmarks.matching.common import Comparison, compare
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.panorama import CameraRig, Panorama
from vrchain.panorama.panorama import pack

POSES = {b"a": Pose(0, 0, 0.3), b"b": Pose(3, 1, -2.0), b"c": Pose(-2, 1, 3.1)}
BLOBS = {key: sights.look(pose).encode() for key, pose in POSES.items()}
RECORDS = {b"a": b"what a shows"}


def by_sift(a: Features, b: Features) -> Comparison:
    return compare(a, b, RIG)


def index_of(told: list[bytes | None] | None = None) -> LandmarkIndex[Features]:
    """told: what is published with each panorama that is looked at."""

    def look(panorama: bytes, landmarks: bytes | None) -> Features:
        if told is not None:
            told.append(landmarks)
        return extract(Panorama.decode(panorama))

    return LandmarkIndex(BLOBS.__getitem__, RECORDS.get, look, by_sift)


def same(a: Comparison, b: Comparison) -> bool:
    return [(c.score, c.a, c.b) for c in a.common] == [(c.score, c.a, c.b) for c in b.common]


def test_the_index_says_what_comparing_says() -> None:
    index = index_of()
    direct = by_sift(*(extract(Panorama.decode(BLOBS[key])) for key in (b"a", b"b")))
    assert direct.common
    assert same(index.compare(b"a", b"b"), direct)
    assert same(index.compare_with(index.look(b"a"), b"b"), direct)
    assert (index.panorama(b"c").views == Panorama.decode(BLOBS[b"c"]).views).all()


def test_each_panorama_is_looked_at_once_and_each_pair_compared_once() -> None:
    told: list[bytes | None] = []
    index = index_of(told)
    first = index.compare(b"a", b"b")
    assert index.compare(b"a", b"b") is first
    index.compare(b"b", b"a"), index.compare(b"b", b"c"), index.compare(b"a", b"c")
    index.compare_with(index.look(b"a"), b"c")
    assert told == [b"what a shows", None, None] and index.n_compared == 5


def test_what_is_no_panorama_is_an_error_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(BLOBS, b"a", b"junk")
    index = index_of()
    for _ in range(2):
        with pytest.raises(ImageError):
            index.look(b"a")


def test_by_which_cameras_a_panorama_is_is_known_before_it_is_opened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One of 2^27 pixels in a few kilobytes would take seconds and gigabytes."""
    bomb = pack(CameraRig(width_px=4096, height_px=4096), "png", [b"no picture"] * 8)
    monkeypatch.setitem(BLOBS, b"bomb", bomb)
    index = index_of()
    assert index.is_by(RIG, b"a") and not index.is_by(RIG, b"bomb")
    monkeypatch.setitem(BLOBS, b"junk", b"junk")
    with pytest.raises(ImageError):
        index.is_by(RIG, b"junk")
