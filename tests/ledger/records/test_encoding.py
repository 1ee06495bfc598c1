"""The encoding is canonical and strict, and garbage never gets past the decoders."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ledgers import KEYS, OPERATOR_KEY, PUBLIC, garbage, new_chain, next_entry

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.receiver import accept
from vrchain.ledger.errors import EncodingError, RecordError, TooLargeError
from vrchain.ledger.records.block import Block, decode_record
from vrchain.ledger.records.encoding import (
    MAX_RECORD_BYTES,
    decode,
    digest,
    encode,
    encode_fields,
    split,
)
from vrchain.ledger.records.membership import Drop, Enrolment, Expulsion, Genesis
from vrchain.ledger.records.merkle import EMPTY_ROOT, Tree, climb
from vrchain.ledger.records.proof import Proof
from vrchain.ledger.records.table import Table
from vrchain.ledger.records.transaction import REASONS, Transaction
from vrchain.ledger.rules.chain import genesis_entry

integers = st.integers(0, 2**63 - 1)
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
leaves = integers | texts | st.binary(max_size=40)
fields = st.recursive(leaves, lambda inner: st.lists(inner, max_size=4).map(tuple), max_leaves=8)
names = st.from_regex(r"[A-Za-z0-9][A-Za-z0-9._-]{0,20}", fullmatch=True).filter(
    lambda name: name != "operator"
)
digests = st.binary(min_size=32, max_size=32)
operators = (digests, integers, integers)
blobs = st.sets(digests, min_size=1, max_size=5).map(sorted).map(tuple)
drafts = st.one_of(
    st.builds(Transaction, digests, names, integers, integers, st.sampled_from(REASONS),
              digests, digests, digests),
    st.builds(Block, integers, digests, integers, digests, digests, names),
    st.builds(Enrolment, *operators, names, st.just(PUBLIC["R1"])),
    st.builds(Expulsion, *operators, names),
    st.builds(Drop, *operators, blobs),
)  # fmt: skip

GENESIS = genesis_entry(PUBLIC, OPERATOR_KEY, 0, "golden")
LEDGER_ID = GENESIS.records[0].id
TRANSACTION = Transaction(
    LEDGER_ID, "R1", 3, 5_000, "view", digest(b"payload"), digest(b"landmarks"), digest(b"previous")
)
ENROLMENT = Enrolment(LEDGER_ID, 0, 6_000, "R3", KEYS["R3"].public)
EXPULSION = Expulsion(LEDGER_ID, 1, 6_000, "R3")
DROP = Drop(LEDGER_ID, 2, 6_000, (digest(b"payload"),))
BLOCK = Block(1, GENESIS.block.hash, 7_000, digest(b"records"), digest(b"newest"), "R1")
RECORDS = {
    "genesis": GENESIS.records[0].record,
    "transaction": TRANSACTION.signed(KEYS["R1"]).record,
    "enrolment": ENROLMENT.signed(OPERATOR_KEY).record,
    "expulsion": EXPULSION.signed(OPERATOR_KEY).record,
    "drop": DROP.signed(OPERATOR_KEY).record,
    "block": BLOCK.signed(KEYS["R1"]).record,
}
PROOF = Proof(RECORDS["block"], ((0, bytes(32)), (1, digest(b"sibling")))).encode()


KINDS = (Transaction, Enrolment, Expulsion, Drop, Genesis, Block)
DECODERS: list[Callable[[bytes], object]] = [split, Proof.decode, decode_record]
DECODERS += [kind.decode for kind in KINDS]


def test_the_bytes_are_as_documented() -> None:
    assert encode("d", 1, "ü", b"\x00", ()) == (
        b"s\0\0\0\x01d" + b"i\0\0\0\x08" + bytes(7) + b"\x01" + b"s\0\0\0\x02\xc3\xbc"
        b"b\0\0\0\x01\x00" + b"t\0\0\0\0"
    )


def test_golden_digests() -> None:
    """These change only with the format's version."""
    assert {name: digest(record).hex() for name, record in RECORDS.items()} == {
        "genesis": "8672670e19e71b2b8b7e7aebf48680bc72733c5f7ab713ff689646c1f15fb59b",
        "transaction": "4225173c0ca2da9c569689adf637c8f36c384843c41d0c66b9bc0fa13bff5225",
        "enrolment": "82df47a239d35233b02899ca69b96d3addf9e970ae7957c6f0c33eff1cd01153",
        "expulsion": "2270eeeb6e250acb309725cbc58f5576e945a0d3cd0451088cf25fa1755203d7",
        "drop": "fd3e81ec46584b39b24dd78aa81e129237524d960364fe722a177bc292a4cd94",
        "block": "4db7a0d0716969f183f1ad5a11aee6d5d8dc1e2e4537c109fee0161d3317130b",
    }
    three = {"R1": bytes(32), "R2": b"\1" * 32, "R3": b"\2" * 32}
    assert Table(three).root.hex() == (
        "4455864317e501d537225dbbea09b7bbbd08a41c6577398e74a33f6e8c6a4b5e"
    )
    assert GENESIS.block.records_root.hex() == (
        "24142e2e62ed8197e7c8bcef7e88d87d8646065a7f1d931bcd3cf5c0c5e79c92"
    )


@given(texts, st.lists(fields, max_size=5))
def test_round_trip(domain: str, values: list[Any]) -> None:
    try:
        data = encode(domain, *values)
        assert decode(data, domain) == tuple(values)
    except EncodingError as error:
        assert "deep" in str(error)


@given(st.binary(max_size=200))
def test_what_decodes_is_canonical(data: bytes) -> None:
    try:
        domain, values = split(data)
    except LedgerError:
        return
    assert encode(domain, *values) == data


@given(drafts)
def test_records_round_trip(draft: Transaction | Block | Enrolment | Expulsion | Drop) -> None:
    record = draft.signed(KEYS["R1"])
    again = type(draft).decode(record.record)
    assert (again, again.id) == (record, record.id)
    if isinstance(again, Block):
        with pytest.raises(RecordError, match="ask a ledger"):
            _ = again.newest
    else:
        assert decode_record(record.record) == record


@given(st.lists(digests, min_size=1, max_size=40), st.data())
def test_merkle_trees(leaves: list[bytes], data: st.DataObject) -> None:
    """Leaves replaced are as if the tree were grown anew; every path climbs to the root."""
    others = data.draw(st.dictionaries(st.integers(0, len(leaves) - 1), digests))
    tree = Tree(leaves).replaced(others)
    changed = [others.get(place, leaf) for place, leaf in enumerate(leaves)]
    assert tree.root == Tree(changed).root
    for number, leaf in enumerate(changed):
        path = tree.path(number)
        assert climb(leaf, path) == tree.root
        assert len(path) <= (len(leaves) - 1).bit_length()
    assert (tree.root == Tree(leaves).root) == (changed == leaves)


def test_roots_differ_by_every_row_and_their_number() -> None:
    rows = {f"R{number}": bytes([number]) * 32 for number in range(5)}
    tables = [rows, {}, rows | {"R1": bytes(32)}, rows | {"R5": bytes(32)}]
    tables += [{robot: rows[robot] for robot in rows if robot != left_out} for left_out in rows]
    assert len({Table(newest).root for newest in tables}) == len(tables)
    assert Table({}).root == EMPTY_ROOT
    assert Table(rows).replaced({"R1": bytes(32)}).rows == Table(rows | {"R1": bytes(32)}).rows


@pytest.mark.parametrize("count", [500, pytest.param(100_000, marks=pytest.mark.slow)])
def test_garbage_raises_only_the_ledgers_own_errors(
    count: int, capsys: pytest.CaptureFixture[str]
) -> None:
    chain = new_chain()
    block = next_entry(chain).block.record
    decoders = [
        *DECODERS,
        lambda data: accept(None, data),
        lambda data: accept(chain, encode_fields("vrchain/2/message/entry", block, (data,), ())),
    ]
    refused, strings = 0, garbage(count, [*RECORDS.values(), PROOF])
    for data in strings:
        for decoder in decoders:
            try:
                decoder(data)
            except LedgerError:
                refused += 1
    assert refused > 10 * count
    with capsys.disabled():
        tried = len(strings) * len(decoders)
        print(f"\n{len(strings)} strings, {len(decoders)} decoders: {refused} of {tried} refused")


@pytest.mark.parametrize("value", [None, 1, "text", bytearray(b"b"), [b""]])
def test_what_is_no_bytes_is_refused(value: object) -> None:
    for decoder in DECODERS:
        with pytest.raises(EncodingError):
            decoder(value)


@pytest.mark.parametrize("kind", RECORDS)
@pytest.mark.parametrize("decoder", KINDS)
def test_no_kind_passes_for_another(kind: str, decoder: type[Transaction]) -> None:
    if decoder.__name__.lower() == kind:
        assert decoder.decode(RECORDS[kind]).record == RECORDS[kind]
    else:
        with pytest.raises(EncodingError):
            decoder.decode(RECORDS[kind])


@pytest.mark.parametrize(
    "data",
    {
        "empty": b"",
        "no domain": b"i\0\0\0\x08" + bytes(8),
        "short head": encode("d") + b"i\0\0",
        "short field": encode("d") + b"b\0\0\0\x02x",
        "huge length": encode("d") + b"b\xff\xff\xff\xff",
        "unknown tag": encode("d") + b"x\0\0\0\0",
        "short integer": encode("d") + b"i\0\0\0\x01\x01",
        "negative integer": encode("d") + b"i\0\0\0\x08" + b"\xff" * 8,
        "no UTF-8": encode("d") + b"s\0\0\0\x01\xff",
        "deep": encode("d", ((((b"",),),),)) + b"t\0\0\0\x05" * 9,
        "trailing byte": encode("d", 1) + b"\0",
    }.items(),
    ids=lambda item: item[0],
)
def test_bytes_that_are_not_canonical_are_refused(data: tuple[str, bytes]) -> None:
    with pytest.raises(EncodingError):
        split(data[1])


@pytest.mark.parametrize("value", [-1, 2**63, True, None, 1.5, "\ud800", [1], bytearray()])
def test_values_without_an_encoding_are_refused(value: object) -> None:
    with pytest.raises(EncodingError):
        encode("d", value)


def test_records_are_limited_in_size() -> None:
    with pytest.raises(TooLargeError):
        encode("d", bytes(MAX_RECORD_BYTES))
    with pytest.raises(TooLargeError):
        split(bytes(MAX_RECORD_BYTES + 1))


@pytest.mark.parametrize(
    ("field", "values"),
    {
        "ledger_id": [bytes(31)],
        "robot": ["", "R 1", "../R1", "R1\n", "\uff321", "R" * 65],
        "sequence": [-1, True],
        "timestamp_ns": [1.0, 2**63],
        "reason": ["because"],
        "payload_digest": ["00" * 32],
        "landmarks_digest": [None],
        "previous": [bytes(33)],
    }.items(),
)
def test_fields_that_are_not_allowed_are_refused(field: str, values: list[object]) -> None:
    for value in values:
        with pytest.raises(RecordError):
            replace(TRANSACTION, **{field: value})


def test_the_id_covers_the_signature() -> None:
    signed = TRANSACTION.signed(KEYS["R1"])
    other = TRANSACTION.signed(KEYS["R2"])
    assert signed.body == other.body
    assert signed.id != other.id
    with pytest.raises(RecordError, match="signature"):
        _ = TRANSACTION.id  # a draft has none
