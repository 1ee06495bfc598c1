"""The network's weights: kept with the package, read without trusting the file.

A file holds tensors and their names alone (``weights_only``: no code runs on reading), at half
precision. Their digest goes into every landmark record, for only records of the same weights can
be compared.
"""

import hashlib
import io
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from vrchain.errors import LearnedError
from vrchain.extras import require
from vrchain.files import write_file

if TYPE_CHECKING:
    from vrchain.landmarks.extraction.exact import ExactNetwork
    from vrchain.landmarks.extraction.network import Network

SHIPPED = Path(__file__).with_name("weights_full.pt")
_FORMAT = 1
_MAX_BYTES = 20_000_000


def save_weights(network: "Network", file: Path) -> None:
    """Write the weights, whole or not at all; the same weights are the same bytes."""
    import torch

    state = {
        name: t.half() if t.is_floating_point() else t for name, t in network.state_dict().items()
    }
    buffer = io.BytesIO()
    torch.save({"format": _FORMAT, "weights": state}, buffer)
    write_file(file, buffer.getvalue())


def load_network(file: Path = SHIPPED) -> "ExactNetwork":
    """The network with its weights, ready to propose.

    LearnedError where torch is not installed or the file holds no weights of this network.
    """
    return _load(file, weights_digest(file))


def weights_digest(file: Path = SHIPPED) -> str:
    """SHA-256 of a weights file, in hexadecimal."""
    try:
        found = file.stat()
        if found.st_size > _MAX_BYTES:
            raise LearnedError(f"{file}: expected weights of at most {_MAX_BYTES} bytes")
        return _digest(file, found.st_mtime_ns, found.st_size)
    except OSError as error:
        raise LearnedError(
            f"cannot read the weights {file} ({error.strerror}): make them by `vrchain train`"
        ) from error


@lru_cache(maxsize=2)
def _digest(file: Path, changed_ns: int, size: int) -> str:
    """Of the file as it was last changed: every panorama asks for it, twice."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


@lru_cache(maxsize=2)
def _load(file: Path, digest: str) -> "ExactNetwork":
    network = read_weights(file)
    from vrchain.landmarks.extraction.exact import ExactNetwork

    return ExactNetwork(network)


def read_weights(file: Path = SHIPPED) -> "Network":
    """The network as it was taught. LearnedError as ``load_network``."""
    require("torch", what="the network that proposes landmarks")
    import torch

    from vrchain.landmarks.extraction.network import Network

    network = Network()
    try:
        stored = torch.load(file, map_location="cpu", weights_only=True)
        if stored["format"] != _FORMAT:
            raise LearnedError(
                f"{file}: expected weights of format {_FORMAT}, got {stored['format']!r}: "
                "make them anew by `vrchain train`"
            )
        network.load_state_dict(stored["weights"])
        if not all(torch.isfinite(t).all() for t in network.state_dict().values()):
            raise LearnedError(f"{file}: expected finite weights, got others: make them anew")
    except LearnedError:
        raise
    except Exception as error:  # torch raises almost any kind for what is no weights file
        raise LearnedError(
            f"{file} holds no weights of this network ({type(error).__name__}): "
            "make them by `vrchain train`"
        ) from error
    return network.eval()
