"""Where ``vrchain ledger`` keeps signing keys, a folder for each ledger outside of it; and ledgers,
opened to write with them."""

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from vrchain.errors import LedgerError
from vrchain.ledger import (
    OPERATOR,
    Ledger,
    PublicKey,
    SigningKey,
    Transaction,
    load_key,
    save_key,
    simulated_key,
)
from vrchain.ledger.errors import KeyFileError, LogError, NotALedgerError, UnavailableError
from vrchain.ledger.network.opening import open_ledger
from vrchain.ledger.network.robot import RobotLedger
from vrchain.ledger.storage.durable import sync_folder

_SOON_S, _LATE_S = 5.0, 30.0  # for which servers are waited for

Servers = Annotated[
    str | None,
    typer.Option(metavar="nats://...", help="That carry it: LEDGER is this machine's copy."),
]


def default_keys(operator: PublicKey) -> Path:
    """Each ledger has its own folder of keys, known by its operator's public key."""
    config = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(config) / "vrchain" / "keys" / operator.raw.hex()[:16]


def key_of(ledger: Ledger, keys: Path | None, name: str = OPERATOR) -> SigningKey:
    """The key of a member, or of the operator, in the folder ``keys`` or the ledger's own."""
    return load_key((keys or default_keys(ledger.genesis.operator)) / f"{name}.pem")


def signer(ledger: Ledger, keys: Path | None, name: str, simulated: int | None) -> SigningKey:
    """As ``key_of``, or the key of a simulation's robot where its seed is given."""
    return key_of(ledger, keys, name) if simulated is None else simulated_key(simulated, name)


def member_key(folder: Path, keys: Path | None, name: str, simulated: int | None) -> SigningKey:
    """As ``signer``, where the ledger's folder may not be there yet: then ``keys`` has to be."""
    if simulated is not None:
        return simulated_key(simulated, name)
    if keys is not None:
        return load_key(keys / f"{name}.pem")
    if not folder.exists():
        raise KeyFileError(f"expected --keys, the folder of {name}.pem: {folder} is not there yet")
    with Ledger.open(folder) as ledger:
        return key_of(ledger, None, name)


def writable(ledger: Path, servers: str | None, keys: Path | None, name: str = OPERATOR) -> Ledger:
    """The ledger, to write to: through its servers, where a copy follows some.

    UnavailableError where they are away and the operator is to write; what a robot writes can wait.
    """
    if servers is None:
        return Ledger.open(ledger, writable=True)
    with Ledger.open(ledger) as opened:
        key = key_of(opened, keys, name)
    joined = open_ledger(servers, ledger, key=key, name=name)
    assert isinstance(joined, RobotLedger)
    can_wait = (UnavailableError,) if name != OPERATOR else ()
    try:
        with contextlib.suppress(*can_wait):
            joined.wait_until_followed(_SOON_S if can_wait else _LATE_S)
    except BaseException:
        joined.close()
        raise
    return joined


def handed_on(ledger: Ledger, made: Transaction | None = None) -> str:
    """Wait until servers, if any, have it in the chain, or all that was published; else why not.

    What waits is durable in the folder and goes out when it is next opened with its servers.
    RefusedError where it never comes into the chain.
    """
    if isinstance(ledger, RobotLedger):
        try:
            ledger.wait(made, _LATE_S)
        except UnavailableError as error:
            return str(error)
    return ""


def is_made(folder: Path, operator: PublicKey) -> bool:
    """Whether that operator's ledger is there by now; true, too, if nobody can tell."""
    try:
        with Ledger.open(folder) as ledger:
            return ledger.genesis.operator == operator
    except NotALedgerError:
        return False
    except LedgerError:
        return True


def is_enrolled(ledger: Ledger, name: str) -> bool:
    """Whether a robot is a member by now; true, too, if nobody can tell."""
    with contextlib.suppress(LedgerError):
        if isinstance(ledger, RobotLedger):
            ledger.catch_up()
        ledger.refresh()
        return name in ledger.members
    return True


@contextlib.contextmanager
def saved_keys(
    key_folder: Path, keys: dict[str, SigningKey], is_done: Callable[[], bool] = lambda: False
) -> Iterator[None]:
    """Save the keys before what needs them, durably; take them back if that surely has failed.

    is_done: whether it was done all the same, asked after an error.
    """
    is_new = not key_folder.exists()
    saved: list[Path] = []
    try:
        for name, key in keys.items():
            path = key_folder / f"{name}.pem"
            save_key(key, path)
            saved.append(path)
        for folder in (key_folder, key_folder.absolute().parent):
            with contextlib.suppress(OSError):  # one that may not be read cannot be synced
                sync_folder(folder)
        yield
    except BaseException as error:
        if isinstance(error, LogError) or is_done():
            raise  # it may be done, and then nobody could sign without the keys
        for path in saved:
            path.unlink(missing_ok=True)
        if is_new:
            with contextlib.suppress(OSError):
                key_folder.rmdir()
        raise
