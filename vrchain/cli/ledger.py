"""The command ``vrchain ledger``: make, fill, look at and check a ledger's folder."""

import json
import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from vrchain.cli.ledger_keys import (
    Servers,
    default_keys,
    handed_on,
    is_enrolled,
    is_made,
    key_of,
    saved_keys,
    writable,
)
from vrchain.cli.ledger_panoramas import (
    PICTURES,
    check_landmarks,
    export_pictures,
    panorama_in,
    route,
)
from vrchain.cli.options import Json
from vrchain.errors import printable
from vrchain.files import check_output_file, check_output_folder, check_outside, write_file
from vrchain.ledger import OPERATOR, Ledger, errors, random_key
from vrchain.ledger import verify as verify_ledger
from vrchain.ledger.export import entry_json, record_json
from vrchain.ledger.network.robot import RobotLedger
from vrchain.ledger.records.encoding import MAX_PAYLOAD_BYTES
from vrchain.ledger.records.membership import check_member_name

_DAY_NS = 86_400_000_000_000
_REST_DAYS = 30  # that a ledger may rest before the clock is doubted
_NEWEST = "transaction {sequence}, {reason}, {timestamp_ns} ns, {id}"

app = typer.Typer(no_args_is_help=True, help="Make, fill, look at and check a ledger.")
app.command()(route)

Folder = Annotated[Path, typer.Argument(metavar="LEDGER", help="The ledger's folder.")]
Keys = Annotated[
    Path | None,
    typer.Option(
        help="Folder of the signing keys, outside the ledger [~/.config/vrchain/keys/...]."
    ),
]
ClockIsRight = Annotated[
    bool,
    typer.Option(
        "--clock-is-right", help=f"Write even if the newest block is over {_REST_DAYS} days old."
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
            raise errors.DuplicateMemberError(f"expected each --member once, got {robot} twice")
    signing = {robot: random_key() for robot in [OPERATOR, *members]}
    key_folder = keys or default_keys(signing[OPERATOR].public)
    if key_folder.resolve().is_relative_to(ledger.resolve()):
        raise errors.KeyFileError(f"keys stay outside ledgers, but {key_folder} lies in {ledger}")
    public, now_ns = {robot: signing[robot].public for robot in members}, time.time_ns()
    with (
        saved_keys(key_folder, signing, lambda: is_made(ledger, signing[OPERATOR].public)),
        Ledger.create(
            ledger, public, signing[OPERATOR], timestamp_ns=now_ns, name=name, salt=os.urandom(16)
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
def enroll(
    ledger: Folder,
    name: str,
    keys: Keys = None,
    servers: Servers = None,
    clock_is_right: ClockIsRight = False,
    as_json: Json = False,
) -> None:
    """Take in a new robot NAME, with a new random key, signed by the operator."""
    check_member_name(name)
    with writable(ledger, servers, keys) as opened:
        if name in opened.members:
            raise errors.DuplicateMemberError(f"{name} is a member of {ledger} already")
        if name in opened.expelled:
            raise errors.ExpelledMemberError(
                f"{name} was expelled from {ledger}; choose another name"
            )
        key_folder = keys or default_keys(opened.genesis.operator)
        operator, key = key_of(opened, keys), random_key()
        with saved_keys(key_folder, {name: key}, lambda: is_enrolled(opened, name)):
            opened.enrol(name, key.public, operator, _now_ns(opened, clock_is_right))
        result = {
            "name": name,
            "public_key": key.public.raw.hex(),
            **_head(opened),
            "keys": str(key_folder),
        }
    said = f"enrolled {name} in block {result['height']}; its key is in {key_folder}"
    _say(as_json, result, said)


@app.command()
def expel(
    ledger: Folder,
    name: str,
    keys: Keys = None,
    servers: Servers = None,
    clock_is_right: ClockIsRight = False,
    as_json: Json = False,
) -> None:
    """End the membership of the robot NAME for ever, signed by the operator."""
    with writable(ledger, servers, keys) as opened:
        opened.expel(name, key_of(opened, keys), _now_ns(opened, clock_is_right))
        result = {"name": name, **_head(opened)}
    _say(as_json, result, f"expelled {name} in block {result['height']}; the name is used up")


@app.command()
def append(
    ledger: Folder,
    robot: str,
    file: Path,
    reason: Annotated[
        str | None,
        typer.Option(help="start, distance, view or time; if not given: start, then time."),
    ] = None,
    landmarks: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Its landmark record.")
    ] = None,
    keys: Keys = None,
    servers: Servers = None,
    clock_is_right: ClockIsRight = False,
    as_json: Json = False,
) -> None:
    """Publish the bytes of FILE as ROBOT's, at the present time.

    The folder of a panorama will do too: it is published as robots do, its landmarks beside it.
    While servers are away it waits in LEDGER, and goes out when that is next written to.
    """
    seen = _read_payload(landmarks) if landmarks else None
    payload, seen = panorama_in(file, seen) if file.is_dir() else (_read_payload(file), seen)
    with writable(ledger, servers, keys, robot) as opened:
        opened.refresh()
        waiting = opened.outbox.last(robot) if isinstance(opened, RobotLedger) else None
        reason = reason or ("time" if waiting or opened.latest(robot) else "start")
        key, now_ns = key_of(opened, keys, robot), _now_ns(opened, clock_is_right)
        made = opened.publish(robot, key, payload, reason, now_ns, landmarks=seen)
        why = handed_on(opened, made)
        result = {**_head(opened), **record_json(made)} | ({"waits": why} if why else {})
    place = f"waits to go out, {why}" if why else f"in block {result['height']}"
    _say(as_json, result, f"{made} {place}: {made.id.hex()}")


@app.command()
def show(ledger: Folder, as_json: Json = False) -> None:
    """The head, the robots, and each robot's newest transaction."""
    with Ledger.open(ledger) as opened:
        newest = {robot: opened.latest(robot) for robot in opened.robots}
        public_keys = [opened.genesis.operator, *opened.members.values()]
        result: dict[str, Any] = {
            "name": opened.genesis.name,
            "ledger_id": opened.genesis.id.hex(),
            **_head(opened),
            "timestamp_ns": opened.head.timestamp_ns,
            "insecure": any(key.insecure for key in public_keys),
            "robots": {r: record_json(last) if last else None for r, last in newest.items()},
        }
    lines = [
        f"ledger   {result['ledger_id']} {result['name']}".rstrip(),
        f"head     block {result['height']}, {result['head']}",
        f"keys     {'insecure: simulated' if result['insecure'] else 'live'}",
    ]
    for robot, row in result["robots"].items():
        lines.append(f"{robot:8} {_NEWEST.format(**row) if row else 'nothing yet'}")
    _say(as_json, result, *lines)


@app.command()
def verify(
    ledger: Folder,
    expected_head: Annotated[
        str | None, typer.Option(metavar="HASH", help="A block's hash that must be there.")
    ] = None,
    landmarks: Annotated[
        bool, typer.Option(help="Also extract each robot's newest landmark record again.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Check every byte of every record and payload; exit status 1 when something is wrong."""
    found = verify_ledger(ledger, _hash(expected_head) if expected_head is not None else None)
    result = {name: value for name, value in asdict(found).items() if name != "dropped" or value}
    text = f"{ledger}: all {found.blocks} blocks are good"
    if found.dropped:
        text += f"; blobs dropped, as the operator signed: {found.dropped}"
    if landmarks and found.ok:
        result["landmark_records"] = check_landmarks(ledger)
        text += f"; landmark records as extracted again: {result['landmark_records']}"
    if as_json or found.ok:
        _say(as_json, result, text)
    if not found.ok:
        bad = found.first_bad_block
        place = f"block {bad}" if bad is not None else "beside its blocks"
        raise errors.DamagedError(f"the verification of {ledger} fails, {place}: {found.reason}")


@app.command()
def drop(
    ledger: Folder,
    keep: Annotated[
        int, typer.Option(min=1, help="How many of each robot's newest panoramas stay.")
    ],
    keys: Keys = None,
    servers: Servers = None,
    clock_is_right: ClockIsRight = False,
    as_json: Json = False,
) -> None:
    """Let old panoramas and landmark records go; the operator signs which. Records stay."""
    with writable(ledger, servers, keys) as opened:
        records = opened.drop_old(keep, key_of(opened, keys), _now_ns(opened, clock_is_right))
        result = {"dropped": sum(len(record.blobs) for record in records), **_head(opened)}
    said = f"blobs dropped from {ledger}: {result['dropped']}; its head is block {result['height']}"
    _say(as_json, result, said)


@app.command()
def clean(ledger: Folder, as_json: Json = False) -> None:
    """Remove blobs that no record needs, as a writer that is killed may leave behind."""
    with Ledger.open(ledger, writable=True) as opened:
        count = opened.clean()
    _say(as_json, {"removed": count}, f"removed {count} files from {ledger}")


@app.command()
def export(
    ledger: Folder,
    output: Annotated[
        Path | None, typer.Option("-o", metavar="FILE", help="A file of JSON lines.")
    ] = None,
    pictures: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="A new folder, for the panoramas as PNG.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write every block with its records as one line of JSON, or the panoramas as pictures."""
    if output is None and pictures is None:
        raise errors.RecordError("expected -o FILE or --pictures FOLDER, got neither")
    if output:
        check_output_file(output)
    if pictures:
        check_outside(pictures, ledger, output)
        check_output_folder(pictures, PICTURES)
    for target in (output, pictures):
        if target and target.resolve().is_relative_to(ledger.resolve()):
            raise errors.RecordError(f"expected to write outside the ledger, got {target}")
    result: dict[str, Any] = {}
    said = []
    with Ledger.open(ledger) as opened:
        if output:
            lines = [json.dumps(entry_json(entry)) + "\n" for entry in opened.entries()]
            write_file(output, "".join(lines).encode())
            result |= {"file": str(output), "blocks": len(lines)}
            said.append(f"wrote {len(lines)} blocks to {output}")
        if pictures:
            counts = export_pictures(opened, pictures)
            result |= {"folder": str(pictures), **counts}
            said.append(f"wrote {counts['pictures']} pictures to {pictures}")
            said += [f"payloads that are no panoramas: {n}"] if (n := counts["others"]) else []
            said += [f"dropped: {n}"] if (n := counts["dropped"]) else []
    _say(as_json, result, "; ".join(said))


def _say(as_json: bool, result: dict[str, Any], *lines: str) -> None:
    typer.echo(json.dumps(result) if as_json else "\n".join(map(printable, lines)))


def _head(ledger: Ledger) -> dict[str, Any]:
    return {"height": ledger.head.height, "head": ledger.head.hash.hex()}


def _now_ns(ledger: Ledger, clock_is_right: bool) -> int:
    """The present time, unless the ledger makes it doubtful: no later time may be below it."""
    now_ns, newest_ns = time.time_ns(), ledger.head.timestamp_ns
    days = (now_ns - newest_ns) / _DAY_NS
    if newest_ns and days > _REST_DAYS and not clock_is_right:  # 0: made without a clock
        raise errors.ClockSkewError(
            f"expected the present time within {_REST_DAYS} days of the ledger's newest block, got "
            f"{days:.0f} days after it, which no later time may precede; set the clock, or if it "
            "is right, say --clock-is-right"
        )
    return now_ns


def _read_payload(file: Path) -> bytes:
    try:
        with open(file, "rb") as source:
            payload = source.read(MAX_PAYLOAD_BYTES + 1)
    except OSError as error:
        raise errors.PayloadFileError(
            f"expected a readable FILE, got {file}: {error.strerror}"
        ) from None
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise errors.TooLargeError(f"expected a FILE of at most {MAX_PAYLOAD_BYTES} bytes: {file}")
    return payload


def _hash(text: str) -> bytes:
    try:
        value = bytes.fromhex(text)
    except ValueError:
        value = b""
    if len(value) != 32:
        raise errors.RecordError(f"expected a HASH of 64 hexadecimal digits, got {text!r:.80}")
    return value
