"""The network sees a ring, and answers alike whether it is learning or not."""

import pytest

from vrchain.landmarks.extraction.raster import CELL_PX, ROWS

torch = pytest.importorskip("torch", reason="the network needs torch (extra `learned`)")
from vrchain.landmarks.extraction.network import ANSWERS, Network, has_bfloat16  # noqa: E402
from vrchain.landmarks.extraction.proposer import LOCAL  # noqa: E402

TURN = 32  # pixels of the coarsest cell that takes part


@pytest.fixture(scope="module")
def network() -> Network:
    torch.manual_seed(0)
    return Network().eval()


@pytest.fixture(scope="module")
def picture() -> "torch.Tensor":
    return torch.rand(1, 3, ROWS, 160, generator=torch.Generator().manual_seed(1))


def test_each_cell_is_answered_and_nothing_is_cut_at_the_seam(
    network: Network, picture: "torch.Tensor"
) -> None:
    with torch.inference_mode():
        found, turned = network(picture), network(picture.roll(TURN, dims=-1))
    for name, n in {**ANSWERS, "local": LOCAL}.items():
        assert found[name].shape == (1, n, ROWS // CELL_PX, 160 // CELL_PX)
        if name in ANSWERS:
            torch.testing.assert_close(turned[name], found[name].roll(TURN // CELL_PX, dims=-1))


def test_learning_or_not_it_answers_alike(network: Network, picture: "torch.Tensor") -> None:
    learning = network(picture)
    with torch.no_grad():
        found = network(picture)
    for name, answer in found.items():
        torch.testing.assert_close(answer, learning[name].detach())


@pytest.mark.parametrize("has", ["avx512_bf16", "amx_bf16", "avx2"])
def test_it_learns_in_what_the_processor_has(monkeypatch: pytest.MonkeyPatch, has: str) -> None:
    """Emulated, bfloat16 takes ten times as long as float32."""
    monkeypatch.delenv("VRCHAIN_BFLOAT16", raising=False)
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"avx512_bf16": False, has: True})
    assert has_bfloat16() == (has != "avx2")
    monkeypatch.setenv("VRCHAIN_BFLOAT16", "0")
    assert not has_bfloat16()
