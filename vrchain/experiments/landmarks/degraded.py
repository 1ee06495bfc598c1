"""How common landmarks stand bad pictures and cameras at other heights: the same pairs, each way.

The first panorama is as drawn, the second is spoilt; resolution and height are those of both.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import ImageError
from vrchain.experiments.intervals import shown
from vrchain.experiments.landmarks.degradations import (
    blurred,
    compressed,
    exposed,
    noisy,
    sunflare,
)
from vrchain.experiments.landmarks.precision import AS_DRAWN, Second, evaluate, summarise
from vrchain.experiments.scenes import Scenes, remembered
from vrchain.landmarks.matching.common import check_comparable
from vrchain.landmarks.matching.variants import Variant, at_half_resolution
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator

FIGURES = ("pair_success", "precision", "recall", "false_claim_rate")


@dataclass(frozen=True)
class Way:
    """One row: what is done to the second panorama, to both, and how high both cameras are."""

    name: str
    second: Second = AS_DRAWN
    both: Callable[[Variant], Variant] = lambda variant: variant
    height_m: float = CameraRig.camera_height_m


TILTS = {f"tilt {degrees:g} degrees": degrees for degrees in (1.0, 2.0, 5.0)}
WAYS = (
    Way("none"),
    *(
        Way(name, Second(name, spoil))
        for name, spoil in {
            "blur": blurred,
            "noise": noisy,
            "half the light": exposed(0.5),
            "twice the light": exposed(2.0),
            "sunflare": sunflare,
            "JPEG quality 20": compressed,
        }.items()
    ),
    *(Way(name, Second(name, tilt_deg=degrees)) for name, degrees in TILTS.items()),
    Way("half resolution", both=at_half_resolution),
    *(Way(f"cameras {height_m:g} m high", height_m=height_m) for height_m in (0.3, 0.5, 1.5, 2.0)),
    Way("second camera 0.5 m higher", Second("higher", rise_m=0.5)),
)


def evaluate_ways(
    scenes: Scenes,
    n_pairs: int,
    spacing_m: tuple[float, float],
    variants: Sequence[Variant],
    *,
    seed: int,
    folder: Path,
    rig: CameraRig | None = None,
    ways: Sequence[Way] = WAYS,
) -> pd.DataFrame:
    """What ``precision.summarise`` says of the same pairs in every way: one row a way and variant.

    Columns: way, variant, refused (panoramas so different are not compared: no figures), n_pairs,
    ``FIGURES``, each with its interval as NAME_ci. What was found already is read from ``folder``.
    """
    once, rows = remembered(scenes), list[dict[str, object]]()
    told = ["n_pairs", *(n for name in FIGURES for n in (name, f"{name}_ci"))]
    for way in tqdm(ways, desc="ways", unit="", disable=None):
        own = replace(rig or CameraRig(), camera_height_m=way.height_m)
        if _refused(own, way.second.rig(own)):
            none = {"way": way.name, "refused": True, "n_pairs": 0}
            rows += [none | {"variant": variant.name} for variant in variants]
            continue
        used = [replace(way.both(variant), name=variant.name) for variant in variants]
        where = folder / way.name.replace(" ", "_")
        found = evaluate(
            once, n_pairs, spacing_m, used, seed=seed, folder=where, rig=own, second=way.second
        )
        for variant, figures in summarise(*found).items():
            key = {"way": way.name, "variant": variant, "refused": False}
            rows.append(key | {name: figures[name] for name in told})
    table = pd.DataFrame(rows, columns=["way", "variant", "refused", *told], dtype=object)
    return table.where(table.notna(), None)


def _refused(a: CameraRig, b: CameraRig) -> bool:
    """Whether panoramas of these two rigs are not compared at all."""
    draws = generator(0, "rigs")
    taken = [
        Panorama(r, draws.integers(0, 256, (r.n_views, r.height_px, r.width_px, 3), dtype="uint8"))
        for r in (a, b)
    ]
    try:
        check_comparable(*taken)
    except ImageError:
        return True
    return False


def as_text(rows: pd.DataFrame) -> str:
    """The table to read, intervals in brackets."""
    names = {"n_pairs": "pairs"} | {name: name for name in FIGURES}
    table = [
        {"way": row.way, "variant": row.variant}
        | {
            column: "refused" if row.refused else shown(dict(row), name)
            for name, column in names.items()
        }
        for _, row in rows.iterrows()
    ]
    return pd.DataFrame(table).to_string(index=False)
