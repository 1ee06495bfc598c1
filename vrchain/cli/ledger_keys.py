"""Where ``vrchain ledger`` keeps signing keys: a folder for each ledger, outside of it."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from vrchain.ledger import OPERATOR, Ledger, PublicKey, SigningKey, load_key, save_key


def default_keys(operator: PublicKey) -> Path:
    """Each ledger has its own folder of keys, known by its operator's public key."""
    config = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(config) / "vrchain" / "keys" / operator.raw.hex()[:16]


def key_of(ledger: Ledger, keys: Path | None, name: str = OPERATOR) -> SigningKey:
    """The key of a member, or of the operator, in the folder ``keys`` or the ledger's own."""
    return load_key((keys or default_keys(ledger.genesis.operator)) / f"{name}.pem")


@contextlib.contextmanager
def saved_keys(key_folder: Path, keys: dict[str, SigningKey]) -> Iterator[None]:
    """Save the keys before what needs them; take them back if that fails."""
    is_new = not key_folder.exists()
    saved: list[Path] = []
    try:
        for name, key in keys.items():
            path = key_folder / f"{name}.pem"
            save_key(key, path)
            saved.append(path)
        yield
    except BaseException:
        for path in saved:
            path.unlink(missing_ok=True)
        if is_new:
            with contextlib.suppress(OSError):
                key_folder.rmdir()
        raise
