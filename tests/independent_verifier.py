"""A verifier made from docs/reference/ledger-format.md alone; it knows nothing of vrchain.

    python independent_verifier.py LEDGER [HEAD_HASH]

Says "good" with the head's hash and how many blobs were dropped, or what is wrong (status 1).
"""

import hashlib
import sqlite3
import sys
from pathlib import Path

from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

ZEROS = bytes(32)


class Bad(Exception): ...


def check(condition, what):
    if not condition:
        raise Bad(what)


def sha(data):
    return hashlib.sha256(data).digest()


def field(value):
    tag, body = (b"s", value.encode()) if isinstance(value, str) else (b"b", value)
    return tag + len(body).to_bytes(4, "big") + body


def fields(data):
    """The values of a sequence of fields."""
    found, position = [], 0
    while position < len(data):
        start = position + 5
        end = start + int.from_bytes(data[position + 1 : start], "big")
        check(end <= len(data), "a field is cut off")
        tag, body = data[position : position + 1], data[start:end]
        if tag == b"i":
            check(len(body) == 8 and body[0] < 128, "an integer is out of range")
            found.append(int.from_bytes(body, "big"))
        else:
            check(tag in b"sbt", "an unknown tag")
            found.append({b"s": bytes.decode, b"b": bytes, b"t": fields}[tag](body))
        position = end
    return found


def opened(record):
    """The parts of a stored record: kind, its fields, body, signature."""
    outer = fields(record)
    check(outer[0] == "vrchain/2/signed" and len(outer) == 3, "no signed record")
    domain, *values = fields(outer[1])
    check(domain.startswith("vrchain/2/"), f"a record of {domain}")
    return domain.removeprefix("vrchain/2/"), values, outer[1], outer[2]


def root(leaves):
    """The RFC 6962 tree: the left half is the largest power of two below the number of leaves."""
    if len(leaves) < 2:
        return leaves[0] if leaves else sha(field("vrchain/2/empty"))
    half = 1 << (len(leaves) - 1).bit_length() - 1
    return sha(field("vrchain/2/node") + field(root(leaves[:half])) + field(root(leaves[half:])))


def verify(folder, head=None):
    """(hash of the last block, number of dropped blobs); Bad if anything is wrong."""
    place = (Path(folder) / "ledger.sqlite").absolute().as_uri()
    db = sqlite3.connect(f"{place}?mode=ro", uri=True)
    check(db.execute("PRAGMA user_version").fetchone()[0] == 2, "another version")
    blocks = db.execute("SELECT height, hash, record FROM blocks ORDER BY height").fetchall()
    rows = db.execute("SELECT height, position, id, record FROM records ORDER BY height, position")
    stored = {}
    for height, position, record_id, record in rows:
        check(position == len(stored.setdefault(height, [])), f"block {height}: a position")
        check(record_id == sha(record), f"block {height}: a record's id")
        stored[height].append((record_id, record))
    check(blocks and set(stored) == set(range(len(blocks))), "blocks without records")
    operator, keys, newest, expelled, count = None, {}, {}, set(), 0  # (id, sequence, time, blobs)
    previous, time, ledger_id, missing, dropped, known = ZEROS, 0, None, set(), set(), head is None
    for number, (height, block_hash, block) in enumerate(blocks):
        where = f"block {number}"
        kind, values, body, signature = opened(block)
        check((kind, height, block_hash) == ("block", number, sha(block)), f"{where}: its row")
        stated, link, block_time, records_root, newest_root, author = values
        check((stated, link) == (number, previous) and block_time >= time, f"{where}: its link")
        for record_id, record in stored[number]:
            kind, values, record_body, record_signature = opened(record)
            if kind == "genesis":
                check(number == 0 and ledger_id is None, f"{where}: a genesis record")
                operator, ledger_id, when = values[3][0], record_id, values[2]
                keys = {name: key for name, key, _ in values[4]}
                newest, signer = dict.fromkeys(keys), operator
            elif kind == "transaction":
                ledger, robot, sequence, when, reason, payload, landmarks, last = values
                check(ledger == ledger_id and robot in keys, f"{where}: whose transaction?")
                before = newest[robot] or (ZEROS, -1, 0)
                check((last, sequence) == (before[0], before[1] + 1), f"{where}: a sequence")
                check(when >= before[2], f"{where}: order of time")
                check(reason in ("start", "distance", "view", "time"), f"{where}: a reason")
                blobs = {payload} if landmarks == ZEROS else {payload, landmarks}
                newest[robot], signer = (record_id, sequence, when, blobs), keys[robot]
                dropped -= blobs
                paths = {b: Path(folder) / "blobs" / b.hex() for b in blobs}
                missing |= {
                    b for b, p in paths.items() if not p.is_file() or sha(p.read_bytes()) != b
                }
            else:
                check(author == "operator" and values[:2] == [ledger_id, count], f"{where}: {kind}")
                when, signer, count = values[2], operator, count + 1
                if kind == "enrolment":
                    check(values[3] not in keys and values[3] not in expelled, f"{where}: a name")
                    keys[values[3]], newest[values[3]] = values[4], None
                elif kind == "expulsion":
                    check(keys.pop(values[3], None), f"{where}: no member expelled")
                    expelled.add(values[3])
                    del newest[values[3]]
                else:
                    check(kind == "drop", f"{where}: a record of {kind}")
                    kept = set().union(*(last[3] for last in newest.values() if last))
                    check(kept.isdisjoint(values[3]), f"{where}: a newest panorama dropped")
                    dropped |= set(values[3])
                    missing -= set(values[3])
            check(when <= block_time, f"{where}: order of time")
            Ed25519PublicKey.from_public_bytes(signer).verify(record_signature, record_body)
        leaves = [sha(field("vrchain/2/record") + field(i)) for i, _ in stored[number]]
        check(root(leaves) == records_root, f"{where}: its records")
        table = [field(r) + field(newest[r][0] if newest[r] else ZEROS) for r in sorted(newest)]
        leaves = [sha(field("vrchain/2/newest") + row) for row in table]
        check(root(leaves) == newest_root, f"{where}: its table")
        signer = operator if author == "operator" else keys[author] if number else None
        check(signer, f"{where}: its author")
        Ed25519PublicKey.from_public_bytes(signer).verify(signature, body)
        previous, time, known = block_hash, block_time, known or block_hash == head
    check(not missing, f"{len(missing)} blobs are missing or changed, and no drop names them")
    check(known, "the known head is not there")
    return previous, len(dropped)


if __name__ == "__main__":
    try:
        found, n_dropped = verify(sys.argv[1], *map(bytes.fromhex, sys.argv[2:]))
    except (Bad, InvalidSignature, sqlite3.Error, LookupError, ValueError, TypeError) as error:
        sys.exit(f"bad: {type(error).__name__} {error}")
    print(f"good {found.hex()} dropped {n_dropped}")
