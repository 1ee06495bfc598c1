"""The command ``vrchain ledger``: make, fill, look at and check a ledger's folder."""

import contextlib
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from vrchain.files import write_file
from vrchain.ledger import Ledger, PublicKey, SigningKey, load_key, random_key, save_key
from vrchain.ledger import verify as verify_ledger
from vrchain.ledger.encoding import MAX_PAYLOAD_BYTES
from vrchain.ledger.errors import (
    DamagedError,
    DuplicateMemberError,
    KeyFileError,
    PayloadFileError,
    RecordError,
    TooLargeError,
)
from vrchain.ledger.export import entry_json, record_json
from vrchain.ledger.membership import OPERATOR, check_member_name

_NEWEST = "transaction {sequence}, {reason}, {timestamp_ns} ns, {id}"

app = typer.Typer(no_args_is_help=True, help="Make, fill, look at and check a ledger.")

Folder = Annotated[Path, typer.Argument(metavar="LEDGER", help="The ledger's folder.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object instead of text.")]
Keys = Annotated[
    Path | None,
    typer.Option(
        help="Folder of the signing keys, outside the ledger [~/.config/vrchain/keys/...]."
    ),
]


@app.command()
def init(
    ledger: Folder,
    member: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="A robot; give one for each.")
    ] = None,
    name: Annotated[str, typer.Option(help="A name for people.")] = "",
    keys: Keys = None,
    as_json: Json = False,
) -> None:
    """Make a ledger in a new folder, with new random keys for its members and operator."""
    members = member or []
    for robot in members:
        check_member_name(robot)
        if members.count(robot) > 1:
            raise DuplicateMemberError(f"expected each --member once, got {robot} twice")
    signing = {robot: random_key() for robot in [OPERATOR, *members]}
    key_folder = keys or _default_keys(signing[OPERATOR].public)
    if key_folder.resolve().is_relative_to(ledger.resolve()):
        raise KeyFileError(f"keys stay outside ledgers, but {key_folder} lies in {ledger}")
    with (
        _saved_keys(key_folder, signing),
        Ledger.create(
            ledger,
            {robot: signing[robot].public for robot in members},
            signing[OPERATOR],
            timestamp_ns=time.time_ns(),
            name=name,
            salt=os.urandom(16),
        ) as made,
    ):
        result = {
            "ledger": str(ledger),
            "ledger_id": made.genesis.id.hex(),
            "head": made.head.hash.hex(),
            "members": list(made.robots),
            "keys": str(key_folder),
        }
    _say(as_json, result, f"made the ledger {ledger}; its keys are in {key_folder}: keep them safe")


@app.command()
def enroll(ledger: Folder, name: str, keys: Keys = None, as_json: Json = False) -> None:
    """Take in a new robot NAME, with a new random key, signed by the operator."""
    check_member_name(name)
    with Ledger.open(ledger, writable=True) as opened:
        if name in opened.members:
            raise DuplicateMemberError(f"{name} is a member of {ledger} already")
        key_folder = keys or _default_keys(opened.genesis.operator)
        operator = load_key(_key_path(key_folder, OPERATOR))
        key = random_key()
        with _saved_keys(key_folder, {name: key}):
            opened.enrol(name, key.public, operator, time.time_ns())
        result = {
            "name": name,
            "public_key": key.public.raw.hex(),
            "height": opened.head.height,
            "head": opened.head.hash.hex(),
            "keys": str(key_folder),
        }
    _say(
        as_json, result, f"enrolled {name} in block {result['height']}; its key is in {key_folder}"
    )


@app.command()
def append(
    ledger: Folder,
    robot: str,
    file: Path,
    reason: Annotated[
        str | None, typer.Option(help="start, distance, view or time [start, then time].")
    ] = None,
    keys: Keys = None,
    as_json: Json = False,
) -> None:
    """Publish the bytes of FILE as ROBOT's, at the present time."""
    payload = _read_payload(file)
    with Ledger.open(ledger, writable=True) as opened:
        opened.refresh()
        reason = reason or ("time" if opened.latest(robot) else "start")
        key = load_key(_key_path(keys or _default_keys(opened.genesis.operator), robot))
        transaction = opened.publish(robot, key, payload, reason, time.time_ns())
        head = opened.head
    result = {"height": head.height, "head": head.hash.hex(), **record_json(transaction)}
    _say(as_json, result, f"{transaction} in block {head.height}: {transaction.id.hex()}")


@app.command()
def show(ledger: Folder, as_json: Json = False) -> None:
    """The head, the robots, and each robot's newest transaction."""
    with Ledger.open(ledger) as opened:
        newest = {robot: opened.latest(robot) for robot in opened.robots}
        public_keys = [opened.genesis.operator, *opened.members.values()]
        result: dict[str, Any] = {
            "name": opened.genesis.name,
            "ledger_id": opened.genesis.id.hex(),
            "height": opened.head.height,
            "head": opened.head.hash.hex(),
            "timestamp_ns": opened.head.timestamp_ns,
            "insecure": any(key.insecure for key in public_keys),
            "robots": {
                robot: record_json(transaction) if transaction else None
                for robot, transaction in newest.items()
            },
        }
    lines = [
        f"ledger   {result['ledger_id']} {result['name']}".rstrip(),
        f"head     block {result['height']}, {result['head']}",
        f"keys     {'insecure: simulated' if result['insecure'] else 'live'}",
    ]
    for robot, row in result["robots"].items():
        lines.append(f"{robot:8} {_NEWEST.format(**row) if row else 'nothing yet'}")
    _say(as_json, result, "\n".join(lines))


@app.command()
def verify(
    ledger: Folder,
    expected_head: Annotated[
        str | None, typer.Option(metavar="HASH", help="A block's hash that must be there.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Check every byte of every record and payload; exit status 1 when something is wrong."""
    found = verify_ledger(ledger, _hash(expected_head) if expected_head else None)
    result = {
        "ok": found.ok,
        "blocks": found.blocks,
        "first_bad_block": found.first_bad_block,
        "reason": found.reason,
    }
    if as_json or found.ok:
        _say(as_json, result, f"{ledger}: all {found.blocks} blocks are good")
    if not found.ok:
        bad = found.first_bad_block
        place = f"block {bad}" if bad is not None else "beside its blocks"
        raise DamagedError(f"{ledger} is not what was written, {place}: {found.reason}")


@app.command()
def export(
    ledger: Folder,
    output: Annotated[Path, typer.Option("-o", metavar="FILE", help="A file of JSON lines.")],
    as_json: Json = False,
) -> None:
    """Write every block with its records as one line of JSON; payloads by digest."""
    with Ledger.open(ledger) as opened:
        if output.resolve().is_relative_to(ledger.resolve()):
            raise RecordError(f"expected a FILE outside the ledger, got {output}")
        lines = [json.dumps(entry_json(entry)) + "\n" for entry in opened.entries()]
    write_file(output, "".join(lines).encode())
    result = {"file": str(output), "blocks": len(lines)}
    _say(as_json, result, f"wrote {len(lines)} blocks to {output}")


def _say(as_json: bool, result: dict[str, Any], text: str) -> None:
    typer.echo(json.dumps(result) if as_json else text)


def _default_keys(operator: PublicKey) -> Path:
    """Each ledger has its own folder of keys, known by its operator's public key."""
    config = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(config) / "vrchain" / "keys" / operator.raw.hex()[:16]


def _key_path(key_folder: Path, name: str) -> Path:
    return key_folder / f"{name}.pem"


@contextlib.contextmanager
def _saved_keys(key_folder: Path, keys: dict[str, SigningKey]) -> Iterator[None]:
    """Save the keys before what needs them; take them back if that fails."""
    is_new = not key_folder.exists()
    saved: list[Path] = []
    try:
        for name, key in keys.items():
            path = _key_path(key_folder, name)
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


def _read_payload(file: Path) -> bytes:
    try:
        with open(file, "rb") as source:
            payload = source.read(MAX_PAYLOAD_BYTES + 1)
    except OSError as error:
        raise PayloadFileError(f"expected a readable FILE, got {file}: {error.strerror}") from None
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise TooLargeError(f"expected a FILE of at most {MAX_PAYLOAD_BYTES} bytes: {file}")
    return payload


def _hash(text: str) -> bytes:
    try:
        value = bytes.fromhex(text)
    except ValueError:
        value = b""
    if len(value) != 32:
        raise RecordError(f"expected a HASH of 64 hexadecimal digits, got {text!r:.80}")
    return value
