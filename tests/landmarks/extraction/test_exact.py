"""Robots run the network in whole numbers: the same bits everywhere, and what it has learned."""

import os
import subprocess
import sys

import numpy as np
import pytest
from numpy.typing import NDArray

from vrchain.landmarks.extraction.raster import ROWS
from vrchain.seeding import generator

torch = pytest.importorskip("torch", reason="the network needs torch (extra `learned`)")
from vrchain.landmarks.extraction.exact import ExactNetwork, _exact  # noqa: E402
from vrchain.landmarks.extraction.network import Network, has_bfloat16  # noqa: E402
from vrchain.landmarks.extraction.weights import load_network, read_weights  # noqa: E402

POOREST = {"ATEN_CPU_CAPABILITY": "default", "ONEDNN_MAX_CPU_ISA": "SSE41", "VRCHAIN_BFLOAT16": "0"}


def picture(columns: int = 320) -> NDArray[np.uint8]:
    """Something of every size, from noise to areas of one colour."""
    draws = generator(0, "exact")
    found = np.zeros((ROWS, columns, 3))
    for cell in (1, 4, 16, 64):
        shape = -(-ROWS // cell), -(-columns // cell), 3
        coarse = draws.uniform(0, 64, shape)
        found += coarse.repeat(cell, axis=0).repeat(cell, axis=1)[:ROWS, :columns]
    found[: ROWS // 3, : columns // 2] = 255
    return found.astype(np.uint8)


def check_same_bits(network: Network, shown: NDArray[np.uint8]) -> None:
    """In bfloat16 and in float32."""
    in_half, in_full = (ExactNetwork(network, half)(shown) for half in (True, False))
    for name, answer in in_half.items():
        assert np.isfinite(answer).all() and np.array_equal(answer, in_full[name]), name


@pytest.mark.skipif(not has_bfloat16(), reason="this processor does not compute in bfloat16")
def test_bfloat16_and_float32_give_the_same_bits() -> None:
    check_same_bits(read_weights(), picture())


def test_an_untaught_network_too() -> None:
    """Whatever it has learned: the largest weights and none at all."""
    torch.manual_seed(0)
    network = Network().eval()
    with torch.no_grad():
        network.fine.conv.weight.mul_(1e4)
        network.coarse.conv.weight.zero_()
    check_same_bits(network, picture(64))


def test_a_poorer_processor_gives_the_same_bits() -> None:
    script = (
        "import hashlib; from test_exact import picture;"
        "from vrchain.landmarks.extraction.weights import load_network;"
        "f = load_network()(picture());"
        "print(*(hashlib.sha256(a.tobytes()).hexdigest() for a in f.values()))"
    )
    path = os.pathsep.join([os.path.dirname(__file__), os.getcwd()])
    told = [
        subprocess.run(
            [sys.executable, "-c", script], env={**os.environ, "PYTHONPATH": path, **env},
            capture_output=True, text=True, check=True,
        ).stdout
        for env in ({}, POOREST)
    ]  # fmt: skip
    assert told[0] == told[1] and len(told[0].split()) == 7


def test_it_answers_as_it_was_taught() -> None:
    learned, shown = read_weights(), picture()
    exact = load_network()(shown)
    with torch.inference_mode():
        pixels = torch.from_numpy(shown).permute(2, 0, 1)[None].float() / 255
        plain = {name: answer[0].numpy() for name, answer in learned(pixels).items()}
    for name in ("embedding", "local"):
        a, b = (x[name].reshape(len(x[name]), -1) for x in (exact, plain))
        cosine = (a * b).sum(0) / np.linalg.norm(a, axis=0) / np.linalg.norm(b, axis=0)
        assert np.quantile(cosine, 0.05) > 0.99
    off = 1 / (1 + np.exp(-exact["landmark"])) - 1 / (1 + np.exp(-plain["landmark"]))
    assert np.quantile(np.abs(off), 0.95) < 0.05


def test_no_sum_is_longer_than_float32_holds() -> None:
    draws = torch.Generator().manual_seed(0)
    size = torch.logspace(-6, 3, 40).double()
    weight = torch.randn(40, 64, 3, 3, generator=draws).double() * size[:, None, None, None]
    bias = torch.randn(40, generator=draws).double() * size * 50
    whole, added = _exact(weight, bias, 512.0)
    for w, b, true in zip(whole, added, weight, strict=True):
        largest = float(w.abs().sum() * 512 + b.abs())
        least = min(float(x.abs()[x != 0].min()) for x in (w, b) if (x != 0).any())
        step = 2.0 ** np.floor(np.log2(least))
        while (w / step).round().ne(w / step).any() or (b / step).round() != b / step:
            step /= 2
        assert largest / step < 2**24
        assert float((w - true).abs().max()) <= 0.02 * float(true.abs().max())
    assert torch.equal(whole.bfloat16().double(), whole)
    assert torch.equal(added.bfloat16().double(), added)
