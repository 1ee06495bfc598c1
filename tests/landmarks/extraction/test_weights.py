import pickle
from pathlib import Path

import pytest

from vrchain.errors import LearnedError
from vrchain.landmarks.extraction.weights import (
    load_network,
    read_weights,
    save_weights,
    weights_digest,
)

torch = pytest.importorskip("torch", reason="learned features need torch (extra `learned`)")


def network(seed: int = 0):
    from vrchain.landmarks.extraction.network import Network

    torch.manual_seed(seed)
    return Network()


def test_weights_come_back_and_the_same_weights_are_the_same_bytes(tmp_path: Path) -> None:
    before = network()
    for name, seed in (("a.pt", 0), ("b.pt", 0), ("c.pt", 1)):
        save_weights(network(seed), tmp_path / name)
    after = read_weights(tmp_path / "a.pt").state_dict()
    for name, tensor in before.state_dict().items():
        assert torch.allclose(tensor.float(), after[name].float(), rtol=1e-3, atol=1e-6), name
    assert (tmp_path / "a.pt").stat().st_size < 20_000_000
    assert sorted(f.name for f in tmp_path.iterdir()) == ["a.pt", "b.pt", "c.pt"]
    digest = [weights_digest(tmp_path / f"{name}.pt") for name in "abc"]
    assert digest[0] == digest[1] != digest[2]


class Poison:
    """Unpickling it would write a file."""

    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self):
        return Path.touch, (self.target,)


def test_a_poisoned_file_runs_nothing(tmp_path: Path) -> None:
    mark = tmp_path / "poisoned"
    torch.save({"format": 1, "weights": Poison(mark)}, tmp_path / "w.pt")
    (tmp_path / "p.pt").write_bytes(pickle.dumps(Poison(mark), protocol=2))
    for name in ("w.pt", "p.pt"):
        with pytest.raises(LearnedError, match="holds no weights of this network"):
            load_network(tmp_path / name)
    assert not mark.exists()


@pytest.mark.parametrize(
    "name", ["another architecture", "another shape", "not finite", "another format"]
)
def test_other_weights_are_refused(tmp_path: Path, name: str) -> None:
    state, file = network().state_dict(), tmp_path / "w.pt"
    if name == "another architecture":
        state = {f"other.{key}": value for key, value in state.items()}
    elif name == "another shape":
        state["answers.conv.weight"] = torch.zeros(3, 3)
    elif name == "not finite":
        state["answers.conv.bias"] = torch.full_like(state["answers.conv.bias"], torch.nan)
    torch.save({"format": 2 if name == "another format" else 1, "weights": state}, file)
    with pytest.raises(LearnedError, match=r"vrchain train|make them anew"):
        load_network(file)


def test_no_weights_and_too_many(tmp_path: Path) -> None:
    with pytest.raises(LearnedError, match="vrchain train"):
        load_network(tmp_path / "absent.pt")
    with (tmp_path / "huge.pt").open("wb") as file:
        file.truncate(10**9)
    with pytest.raises(LearnedError, match="at most"):
        load_network(tmp_path / "huge.pt")
