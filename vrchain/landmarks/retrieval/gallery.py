"""Landmark records of many panoramas side by side: who sees this, who shares a landmark with me.

The embeddings of all their proposals are one matrix. One product with those of a new panorama, or
of pictures of a goal, tells which few are worth a closer look.
"""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.proposer import EMBEDDED, LOCAL
from vrchain.landmarks.extraction.record import (
    LandmarkRecord,
    agree,
    decode_record,
    encode_record,
    examine,
    examine_quickly,
    maker_of,
)
from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.extraction.spots import ONE
from vrchain.landmarks.extraction.weights import SHIPPED
from vrchain.landmarks.matching.calibration import Calibration, load_calibration
from vrchain.landmarks.retrieval.query import Query, depth, worth_of
from vrchain.landmarks.retrieval.template import (
    LOWEST_SLOPE,
    RATIO,
    Sighting,
    locate,
    template_around,
)
from vrchain.panorama import Panorama

Array = NDArray[np.float64]
Key = TypeVar("Key")

# Log-odds that a panorama shows it: of 1, appearance, ten times how alike its spots are, log of its
# range over 15 m, logs of keypoints and of spots that agree. Fitted to 40 goals and 400 panoramas
# of seeds 1001 and 1002, the likeliest of each; three units stricter: nobody is an answer too.
_BELIEF = np.array([-36.0, 1.66, 2.74, 0.56, 1.03, 1.9])
_HOPELESS = -10.0  # belief by appearance alone: what agrees beyond would not do either
# Where one is believed, 0.95 of those so likely show it: 14 goals, 400 panoramas of seed 1300.
_LIKELY = -2.5
_AMONG = 10  # proposals of a panorama, the most alike, whose spots are compared
_SHORT, _LONG = 40, 120  # panoramas looked at more closely; where some are known to show it
_BY_APPEARANCE = 2  # times as many are chosen by appearance alone before
_MORE_SIDES = 16  # of those that are known to show it, from which it is sought anew
_WIDTHS = EMBEDDED, LOCAL


@dataclass(frozen=True, eq=False)
class Gallery(Generic[Key]):
    """Records by key, such as a panorama's digest; nothing that a ledger could not give again.

    embedding: (n, d) of all their proposals; owner: (n,) place of their record in ``keys``.
    """

    keys: tuple[Key, ...]
    records: tuple[LandmarkRecord, ...]
    embedding: NDArray[np.float32]
    owner: NDArray[np.int64]


def gallery_of(records: Mapping[Key, LandmarkRecord]) -> Gallery[Key]:
    """A gallery of records of the same weights."""
    counts = [len(r.proposals) for r in records.values()]
    none = np.empty((0, 0), dtype=np.float32)
    known = [r.proposals.embedding for r in records.values() if len(r.proposals)]
    return Gallery(
        tuple(records), tuple(records.values()), np.concatenate(known) if known else none,
        np.repeat(np.arange(len(counts)), counts),
    )  # fmt: skip


def record_from(
    panorama: bytes, landmarks: bytes | None, weights: Path = SHIPPED
) -> LandmarkRecord:
    """A published panorama's record, as it was published with it.

    Extracted again where none was published, or a damaged one, or one of other weights, or one that
    only says it is of these: it may be anything. ImageError if the panorama is none.
    """
    taken = Panorama.decode(panorama)
    moved: Pose | None = None
    if landmarks is not None:
        with contextlib.suppress(ImageError):
            stored = decode_record(landmarks)
            widths = stored.proposals.embedding.shape[1], stored.spots.descriptors.shape[1]
            if (stored.maker, stored.rig, widths) == (maker_of(weights), taken.rig, _WIDTHS):
                return stored
            moved = stored.moved
    return replace(examine(taken, weights), moved=moved)


def is_extracted(landmarks: bytes, panorama: bytes, weights: Path = SHIPPED) -> bool:
    """Whether a published record is what its panorama gives, extracted again: see ``agree``.

    By either way in which robots extract them. ImageError if the panorama is none.
    """
    taken = Panorama.decode(panorama)
    with contextlib.suppress(ImageError):
        return any(
            agree(landmarks, encode_record(look(taken, weights)))
            for look in (examine_quickly, examine)
        )
    return False


Sightings = tuple[Sighting | None, Sighting | None]
"""By keypoints, and by spots."""


@dataclass(frozen=True)
class Seen(Generic[Key]):
    """A panorama that may show what was sought.

    appearance, alike: how much its proposal looks like it, as a whole and by its spots; see
    ``Query``. sighting, spotted: where its keypoints, and its spots, agree that it is. belief: how
    surely it does show it, by all of them, in log-odds: see ``named``.
    """

    key: Key
    proposal: int
    range_m: float
    appearance: float
    alike: float
    sighting: Sighting | None = None
    spotted: Sighting | None = None

    @property
    def features(self) -> Array:
        """What speaks for it, (6,)."""
        counts = [s.n_matches if s else 0 for s in (self.sighting, self.spotted)]
        signs = [1.0, self.appearance, 10 * self.alike, depth(self.range_m), *np.log1p(counts)]
        return np.array(signs)

    @property
    def belief(self) -> float:
        return float(_BELIEF @ self.features)


def who_sees(
    what: Query, gallery: Gallery[Key], calibration: Calibration | None = None
) -> list[Seen[Key]]:
    """Panoramas that look most as if they showed it, the one most to be believed first.

    Where some surely do, what they show is sought too: it is seen from more sides then.
    """
    calibration = calibration or load_calibration()
    if len(what.embedding) == 0 or len(gallery.owner) == 0:
        return []
    sighted = _sighter(what, gallery)
    found = _likeliest(what, gallery, calibration, sighted, _SHORT)
    sure = [seen for seen in found if seen.belief > 0][:_MORE_SIDES]
    if not sure:
        return found
    places = {key: n for n, key in enumerate(gallery.keys)}
    wider = what.also([(gallery.records[places[s.key]], s.proposal) for s in sure])
    return _likeliest(wider, gallery, calibration, sighted, _LONG)


def _likeliest(
    what: Query,
    gallery: Gallery[Key],
    calibration: Calibration,
    sighted: Callable[[int, int], Sightings],
    most: int,
) -> list[Seen[Key]]:
    """So many panoramas that may show it, looked at more closely."""
    appearance = what.appearance(gallery.embedding, calibration)
    begins = np.searchsorted(gallery.owner, np.arange(len(gallery.records) + 1))
    best = np.array([appearance[a:b].max(initial=-np.inf) for a, b in pairwise(begins)])
    likely: list[tuple[float, int, Seen[Key]]] = []
    for n in map(int, np.argsort(-best, kind="stable")[: _BY_APPEARANCE * most]):
        record, own = gallery.records[n], appearance[begins[n] : begins[n + 1]]
        if len(own) == 0:
            continue
        chosen = np.zeros(len(own), dtype=bool)
        chosen[np.argsort(-own, kind="stable")[:_AMONG]] = True
        alike = what.alike(record.proposals, record.spots.take(chosen[record.spots.owner]))
        worth = np.where(chosen, worth_of(own, alike), -np.inf)
        k = int(worth.argmax())
        range_m = float(record.proposals.range_m[k])
        seen = Seen(gallery.keys[n], k, range_m, float(own[k]), float(alike[k]))
        likely.append((float(worth[k]), n, seen))
    likely.sort(key=lambda found: (-found[0], found[1]))
    found = []
    for _, n, seen in likely[:most]:
        if seen.belief > _HOPELESS:
            sighting, spotted = sighted(n, seen.proposal)
            seen = replace(seen, sighting=sighting, spotted=spotted)
        found.append(seen)
    return sorted(found, key=lambda s: -s.belief)


def named(found: Sequence[Seen[Key]]) -> list[Key]:
    """Who is said to see it, the surest first: nobody, unless one of those found surely does."""
    if not found or found[0].belief <= 0:
        return []
    return [seen.key for seen in found if seen.belief > _LIKELY]


def _sighter(what: Query, gallery: Gallery[Key]) -> Callable[[int, int], Sightings]:
    """Where keypoints, and spots, are found around a record's proposal.

    Those of the picture that looks most like it; what was asked before is remembered.
    """
    pictured = what.embedding[: len(what.pictures)]
    upright = LOWEST_SLOPE, np.inf
    templates = [
        [template_around(of(p), 0.0, p.rig.span_rad / 2, upright) for p in what.pictures]
        for of, _ in _WAYS
    ]

    @cache
    def sighted(n: int, proposal: int) -> Sightings:
        record = gallery.records[n]
        right, left = record.proposals.box[proposal, :2]
        middle_rad, window_rad = float(right + left) / 2, float(left - right) + 0.1
        most_alike = int((pictured @ record.proposals.embedding[proposal]).argmax())
        keypoints, spots = (
            locate(own[most_alike], of(record), middle_rad, window_rad, ratio=ratio)
            for (of, ratio), own in zip(_WAYS, templates, strict=True)
        )
        return keypoints, spots

    return sighted


def _spots(record: LandmarkRecord) -> Features:
    """The spots as features of one size; their neighbours look alike: no ratio test for them."""
    s = record.spots
    descriptors = s.descriptors.astype(np.float32) + np.float32(ONE)  # as unsigned: same distances
    return Features(s.bearing_rad, s.slope, np.zeros(len(s)), descriptors.astype(np.uint8))


# What is matched, and the ratio test.
_WAYS: tuple[tuple[Callable[[LandmarkRecord], Features], float], ...] = (
    (attrgetter("features"), RATIO),
    (_spots, 1.0),
)
