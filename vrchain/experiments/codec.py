"""Which image codec a ledger's panoramas are stored in: their bytes against the landmarks found.

Two panoramas are coded and decoded, and the common landmarks that SIFT then finds are judged by
ground truth. The scene's suburb is drawn anew for every ten pairs or so. Encoding and decoding are
timed by ``perf_counter_ns``.
"""

from collections.abc import Iterator, Sequence, Set
from pathlib import Path
from time import perf_counter_ns

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from tqdm.auto import tqdm

from vrchain.errors import MissionError
from vrchain.experiments.intervals import interval, resampled
from vrchain.experiments.landmarks.pairs import draw_pairs
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.sift import extract
from vrchain.landmarks.matching.common import compare
from vrchain.landmarks.quality import judge, names_in_common
from vrchain.panorama import CameraRig, Codec, Panorama
from vrchain.world import load_scene
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

LOSSLESS = Codec("png")  # what the others are held against
CODECS = (
    LOSSLESS,
    *(Codec("webp", quality) for quality in (90, 80, 70, 50)),
    *(Codec("jpeg", quality) for quality in (95, 90, 80, 70, 50, 30)),
)
SPACING_M = (5.0, 10.0)
_PAIRS_A_SUBURB = 10


def codec_pairs(
    spec: str | Path,
    n_pairs: int,
    *,
    seed: int,
    codecs: Sequence[Codec] = CODECS,
    rig: CameraRig | None = None,
) -> pd.DataFrame:
    """Random pairs of poses in suburbs of the seeds from ``seed`` on, one row a pair and codec.

    Columns: codec, quality, pair, co_visible (landmarks that both see, by truth), right (of them
    found), claims, support (matched keypoints of the right claims), bytes (of a panorama, mean of
    the two), encode_ms, decode_ms (of one panorama).
    Raises SpecError, and MissionError without pairs or where the scene has no room for them.
    """
    if n_pairs < 1:
        raise MissionError(f"expected 1 pair or more to compare, got {n_pairs}")
    rig = rig or CameraRig()
    rows: list[dict[str, object]] = []
    with tqdm(total=n_pairs, desc="pairs", unit="", disable=None) as progress:
        for suburb, first in enumerate(range(0, n_pairs, _PAIRS_A_SUBURB)):
            scene = load_scene(spec, seed=seed + suburb)
            renderer, truth = Renderer(scene), GroundTruth(scene)
            count = min(_PAIRS_A_SUBURB, n_pairs - first)
            pairs = draw_pairs(scene, count, SPACING_M, seed + suburb)
            for number, poses in enumerate(pairs, start=first):
                seen = (renderer.render(poses[0], rig), renderer.render(poses[1], rig))
                shared = names_in_common(truth, *poses, rig)
                pair = {"pair": number, "co_visible": len(shared)}
                rows += [pair | row for row in _coded(seen, poses, truth, shared, codecs)]
                progress.update()
    return pd.DataFrame(rows)


def _coded(
    seen: tuple[Panorama, Panorama],
    poses: tuple[Pose, Pose],
    truth: GroundTruth,
    shared: Set[str],
    codecs: Sequence[Codec],
) -> Iterator[dict[str, object]]:
    """What becomes of one pair under each codec."""
    rig = seen[0].rig
    for codec in codecs:
        start_ns = perf_counter_ns()
        blobs = [panorama.encode(codec) for panorama in seen]
        middle_ns = perf_counter_ns()
        a, b = (Panorama.decode(blob) for blob in blobs)
        end_ns = perf_counter_ns()
        features = (extract(a), extract(b))
        comparison = compare(*features, rig)
        verdicts = judge(comparison, truth, poses, features, rig)
        judged = zip(comparison.common, verdicts, strict=True)
        made = [(claim, verdict) for claim, verdict in judged if not verdict.duplicate]
        right = [claim for claim, verdict in made if verdict.right]
        found = sum(verdict.right and verdict.object_a in shared for _, verdict in made)
        yield {
            "codec": codec.name,
            "quality": codec.quality,
            "right": len(right),
            "found": found,
            "claims": len(made),
            "support": sum(len(claim.support_a) for claim in right),
            "bytes": np.mean([len(blob) for blob in blobs]),
            "encode_ms": (middle_ns - start_ns) / 2e6,
            "decode_ms": (end_ns - middle_ns) / 2e6,
        }


def summarise(found: pd.DataFrame, *, seed: int) -> pd.DataFrame:
    """``codec_pairs``'s table by codec, one row each, the largest first.

    Columns: codec, quality, kilobytes (a panorama, mean), recall and precision of its claims; its
    recall and its support over those of the codec without loss, each with a 95 % interval
    (bootstrap over pairs, the same ones for both): kept, kept_low, kept_high, support_kept, ...;
    encode_ms and decode_ms (medians), n_pairs.
    """
    by_codec = {name: g.sort_values("pair") for name, g in found.groupby(["codec", "quality"])}
    lossless = by_codec[LOSSLESS.name, LOSSLESS.quality]
    again = resampled(len(lossless), seed, "codec")
    rows = []
    for (codec, quality), group in by_codec.items():
        rows.append(
            {
                "codec": codec,
                "quality": quality,
                "kilobytes": group.bytes.mean() / 1e3,
                "recall": group.found.sum() / max(1, group.co_visible.sum()),
                "precision": group.right.sum() / max(1, group.claims.sum()),
                **_kept("kept", group.right, lossless.right, again),
                **_kept("support_kept", group.support, lossless.support, again),
                "encode_ms": group.encode_ms.median(),
                "decode_ms": group.decode_ms.median(),
                "n_pairs": len(group),
            }
        )
    return pd.DataFrame(rows).sort_values("kilobytes", ascending=False, ignore_index=True)


def _kept(
    name: str, part: pd.Series, whole: pd.Series, again: NDArray[np.int64]
) -> dict[str, float]:
    """What is left of a count, (n,) by pair, with its interval; again: (m, n) pairs drawn anew."""
    counts = part.to_numpy(), whole.to_numpy()
    left, all_of_it = (count[again].sum(axis=1) for count in counts)
    low, high = interval(left / np.maximum(1, all_of_it), len(part))
    return {
        name: part.sum() / max(1, whole.sum()), f"{name}_low": low, f"{name}_high": high
    }  # fmt: skip
