"""How far a landmark's look alone tells it from the others: no geometry, no training.

For each landmark that two panoramas share, its true box in A is looked up among the true boxes of
all landmarks visible in B: nearest neighbour by the cosine of ImageNet features.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.ndimage import find_objects
from tqdm.auto import tqdm

from vrchain.errors import MissionError
from vrchain.experiments.intervals import interval, resampled
from vrchain.experiments.landmarks.pairs import draw_pairs
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.backbone import Backbone, Layer, load_backbone
from vrchain.landmarks.quality import co_visible
from vrchain.panorama import CameraRig, Panorama
from vrchain.world.model import Scene
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

# The same measure in another suburb, known beforehand: share right at a spacing in metres.
REFERENCE = {5.0: 0.83, 10.0: 0.68, 20.0: 0.41, 40.0: 0.13}


def distinctiveness(
    scene: Scene,
    spacings_m: Sequence[float],
    n_pairs: int,
    *,
    seed: int,
    rig: CameraRig | None = None,
    layer: Layer = "middle",
) -> pd.DataFrame:
    """Random pairs at each spacing, one row a landmark that both panoramas show.

    Columns: spacing_m, pair, object (its name), right (the nearest in B is the same object),
    candidates (landmarks visible in B, itself among them). Raises LearnedError without torch or
    the weights, MissionError where the scene has no room for such pairs.
    """
    check_request(spacings_m, n_pairs)
    spacings_m = list(dict.fromkeys(spacings_m))
    backbone, rig = load_backbone(layer), rig or CameraRig()
    renderer, truth = Renderer(scene), GroundTruth(scene)
    rows: list[dict[str, object]] = []
    with tqdm(total=n_pairs * len(spacings_m), desc="pairs", unit="", disable=None) as progress:
        for spacing_m in spacings_m:
            pairs = draw_pairs(scene, n_pairs, (spacing_m, spacing_m), seed)
            for number, (a, b) in enumerate(pairs):
                pair = {"spacing_m": float(spacing_m), "pair": number}
                found = _look_up(renderer, truth, backbone, a, b, rig)
                rows += [pair | row for row in found]
                progress.update()
    return pd.DataFrame(rows, columns=["spacing_m", "pair", "object", "right", "candidates"])


def check_request(spacings_m: Sequence[float], n_pairs: int) -> None:
    """Raise MissionError unless there are pairs to draw, some distance apart."""
    if n_pairs < 1 or not spacings_m or not all(0 < s < np.inf for s in spacings_m):
        raise MissionError(
            f"expected 1 pair or more and spacings above 0 m, got {n_pairs} pairs and "
            f"{', '.join(f'{s:g} m' for s in spacings_m) or 'no spacing'}"
        )


def summarise(found: pd.DataFrame, *, seed: int) -> pd.DataFrame:
    """``distinctiveness``'s table by spacing, one row each, indexed from 0.

    Columns: spacing_m, right (share), low and high (95 % interval, bootstrap over pairs), n
    (landmarks looked up), n_pairs (with any), chance (of a blind guess), reference (NaN where none
    is known).
    """
    rows = []
    for spacing_m, group in found.groupby("spacing_m"):
        by_pair = group.groupby("pair").right.agg(["sum", "count"]).to_numpy()
        again = by_pair[resampled(len(by_pair), seed, "distinctiveness")].sum(axis=1)
        low, high = interval(again[:, 0] / again[:, 1], len(by_pair))
        rows.append(
            {
                "spacing_m": spacing_m,
                "right": group.right.mean(),
                "low": low,
                "high": high,
                "n": len(group),
                "n_pairs": len(by_pair),
                "chance": (1 / group.candidates).mean(),
                "reference": REFERENCE.get(group.spacing_m.iloc[0], np.nan),
            }
        )
    return pd.DataFrame(rows)


def _look_up(
    renderer: Renderer, truth: GroundTruth, backbone: Backbone, a: Pose, b: Pose, rig: CameraRig
) -> list[dict[str, object]]:
    """The landmarks that both poses see: object, right, candidates."""
    shared = co_visible(truth, a, b, rig)
    seen = truth.visibility(b, rig)
    objects = truth.scene.objects
    candidates = [int(i) for i in seen.index[seen.visible] if objects[i].landmark]
    if not shared:
        return []
    crops = [
        crop
        for pose, wanted in ((a, shared), (b, candidates))
        for crop in crops_of(renderer.render(pose, rig), truth.look(pose, rig)[0], wanted)
    ]
    embedded = backbone.embed(crops)
    alike = embedded[: len(shared)] @ embedded[len(shared) :].T
    nearest = np.array(candidates)[alike.argmax(axis=1)]
    return [
        {"object": objects[i].name, "right": bool(i == j), "candidates": len(candidates)}
        for i, j in zip(shared, nearest, strict=True)
    ]


def crops_of(
    panorama: Panorama, object_id: NDArray[np.int32], wanted: Sequence[int]
) -> list[NDArray[np.uint8]]:
    """The boxes of objects, each (h, w, 3), in the view that shows most of each.

    object_id: (n_views, height_px, width_px), as ``GroundTruth.look`` gives it; every wanted object
    has to be in it. No margin: what surrounds an object changes with the place it is seen from.
    """
    label_of = np.zeros(max(int(object_id.max()), *wanted) + 1, dtype=np.int64)
    label_of[list(wanted)] = 1 + np.arange(len(wanted))
    labels = np.where(object_id < 0, 0, label_of[object_id])
    pixels = [np.bincount(view.ravel(), minlength=len(wanted) + 1)[1:] for view in labels]
    boxes = [find_objects(view, max_label=len(wanted)) for view in labels]
    views = np.argmax(pixels, axis=0)
    return [panorama.views[view][boxes[view][i]] for i, view in enumerate(views)]
