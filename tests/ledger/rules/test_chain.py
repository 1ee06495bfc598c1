"""Validity: what a replica takes in, and the kind of error for each thing that it refuses."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from ledgers import KEYS, OPERATOR_KEY, PUBLIC, entry_of, new_chain, next_entry

from vrchain.ledger import errors
from vrchain.ledger.records.block import Entry, records_root
from vrchain.ledger.records.encoding import digest
from vrchain.ledger.records.membership import OPERATOR, Drop, Enrolment, Expulsion
from vrchain.ledger.records.table import Table
from vrchain.ledger.records.transaction import NO_TRANSACTION
from vrchain.ledger.rules.chain import Chain, genesis_entry


def two_published() -> Chain:
    """R1 has published twice, R2 never."""
    chain = new_chain()
    chain.append(*next_entry(chain, "R1", 10))
    chain.append(*next_entry(chain, "R1", 20))
    return chain


def changed(chain: Chain, signer: str = "R1", **changes: object) -> Entry:
    """A valid next entry but for its block's signer and these fields of the block."""
    block, records = next_entry(chain, "R1", 30)
    return Entry(replace(block, **changes).signed(KEYS[signer]), records)


def transaction(chain: Chain, signer: str = "R1", **changes: object) -> Entry:
    """A valid next entry but for these fields of its transaction."""
    draft = chain.draft("R1", bytes(32), "view", 30)
    return entry_of(chain, replace(draft, **changes).signed(KEYS[signer]))


def enrolment(chain: Chain, author: str = OPERATOR, signer: str = "", **changes: object) -> Entry:
    draft = Enrolment(*chain.operators_next(30), "R3", KEYS["R3"].public)
    key = KEYS.get(signer, OPERATOR_KEY)
    return entry_of(chain, replace(draft, **changes).signed(key), author=author)


def with_newest(chain: Chain, without: str = "", **newest: bytes) -> Entry:
    """A valid next entry but for the table that its block's root stands for."""
    rows = dict(next_entry(chain, "R1", 30).block.newest) | newest
    rows.pop(without, None)
    return changed(chain, newest_root=Table(rows).root)


def expulsion(chain: Chain, name: str = "R2", author: str = OPERATOR, signer: str = "") -> Entry:
    draft = Expulsion(*chain.operators_next(30), name)
    return entry_of(chain, draft.signed(KEYS.get(signer, OPERATOR_KEY)), author=author)


def drop(chain: Chain, *blobs: bytes, author: str = OPERATOR, signer: str = "") -> Entry:
    draft = Drop(*chain.operators_next(30), tuple(sorted(blobs)))
    return entry_of(chain, draft.signed(KEYS.get(signer, OPERATOR_KEY)), author=author)


def in_one_block(chain: Chain, **changes: object) -> Entry:
    """Two transactions with one number, both signed by R1."""
    first = chain.draft("R1", bytes(32), "view", 30)
    second = replace(first, **changes)
    return entry_of(chain, first.signed(KEYS["R1"]), second.signed(KEYS["R1"]))


X = b"x" * 32
REFUSED: dict[tuple[type[errors.InvalidError], str], Callable[[Chain], Entry]] = {
    (errors.BrokenLinkError, "height skipped"): lambda c: changed(c, height=4),
    (errors.BrokenLinkError, "height repeated"): lambda c: changed(c, height=2),
    (errors.BrokenLinkError, "other parent"): lambda c: changed(c, previous_hash=bytes(32)),
    (errors.TimeOrderError, "block before head"): lambda c: changed(c, timestamp_ns=19),
    (errors.TimeOrderError, "block before record"): lambda c: changed(c, timestamp_ns=29),
    (errors.TimeOrderError, "record before last"): lambda c: transaction(c, timestamp_ns=19),
    (errors.ReplayError, "replayed"): lambda c: entry_of(c, c.latest("R1")),
    (errors.EquivocationError, "number used"): lambda c: transaction(c, sequence=1),
    (errors.ReplayError, "number used long ago"): lambda c: transaction(c, sequence=0),
    (errors.SignatureError, "used by another"): lambda c: transaction(c, "R2", sequence=1),
    (errors.EquivocationError, "two with a number"): lambda c: in_one_block(c, reason="time"),
    (errors.ReplayError, "one twice in a block"): in_one_block,
    (errors.BrokenLinkError, "other previous"): lambda c: transaction(c, previous=bytes(32)),
    (errors.SequenceGapError, "sequence skipped"): lambda c: transaction(c, sequence=3),
    (errors.SignatureError, "signed by another"): lambda c: transaction(c, "R2"),
    (errors.SignatureError, "in another's name"): lambda c: transaction(
        c, robot="R2", sequence=0, previous=NO_TRANSACTION
    ),
    (errors.UnknownMemberError, "not a member"): lambda c: transaction(c, "R3", robot="R3"),
    (errors.WrongLedgerError, "other ledger"): lambda c: transaction(c, ledger_id=bytes(32)),
    (errors.SignatureError, "block re-signed"): lambda c: changed(c, "R3"),
    (errors.UnknownMemberError, "author no member"): lambda c: changed(c, "R3", author="R3"),
    (errors.SignatureError, "author is operator"): lambda c: changed(c, "R3", author=OPERATOR),
    (errors.RecordListError, "not listed"): lambda c: changed(c, records_root=records_root(())),
    (errors.RecordListError, "of another"): lambda c: changed(c, records_root=bytes(32)),
    (errors.RecordListError, "no records"): entry_of,
    (errors.RecordListError, "records missing"): lambda c: Entry(changed(c).block, ()),
    (errors.NewestError, "newest not carried"): lambda c: with_newest(c, R1=NO_TRANSACTION),
    (errors.NewestError, "newest invented"): lambda c: with_newest(c, R3=bytes(32)),
    (errors.NewestError, "robot left out"): lambda c: with_newest(c, "R2"),
    (errors.SignatureError, "enrolled by a member"): lambda c: enrolment(c, signer="R1"),
    (errors.UnknownMemberError, "enrolled in R1's block"): lambda c: enrolment(c, "R1"),
    (errors.DuplicateMemberError, "enrolled twice"): lambda c: enrolment(c, name="R2"),
    (errors.SequenceGapError, "enrolment skipped"): lambda c: enrolment(c, sequence=1),
    (errors.RecordListError, "second genesis"): lambda c: entry_of(c, c.genesis),
    (errors.SignatureError, "expelled by a member"): lambda c: expulsion(c, signer="R1"),
    (errors.UnknownMemberError, "expelled in R1's block"): lambda c: expulsion(c, author="R1"),
    (errors.UnknownMemberError, "expelled who is none"): lambda c: expulsion(c, "R3"),
    (errors.SignatureError, "dropped by a member"): lambda c: drop(c, X, signer="R1"),
    (errors.UnknownMemberError, "dropped in R1's block"): lambda c: drop(c, X, author="R1"),
    (errors.DropError, "newest dropped"): lambda c: drop(c, bytes(32), X),
}


@pytest.mark.parametrize("refused", REFUSED, ids=lambda refused: refused[1])
def test_each_refusal_has_its_kind_and_changes_nothing(
    refused: tuple[type[errors.InvalidError], str],
) -> None:
    chain = two_published()
    head, latest = chain.head, chain.latest("R1")
    with pytest.raises(errors.InvalidError) as raised:
        chain.append(*REFUSED[refused](chain))
    assert type(raised.value) is refused[0]
    assert len(str(raised.value)) > 20
    assert (chain.head, chain.latest("R1")) == (head, latest)
    chain.append(*next_entry(chain, "R1", 30))  # and the honest one still passes


def test_a_chain_carries_every_robots_newest() -> None:
    chain = two_published()
    assert chain.head.height == 2
    first = chain.latest("R1")
    assert first.sequence == 1
    assert chain.latest("R2") is None
    assert chain.head.newest == (("R1", first.id), ("R2", NO_TRANSACTION))
    chain.append(*next_entry(chain, "R2", 20))  # the same nanosecond is in order
    assert chain.head.newest == (("R1", first.id), ("R2", chain.latest("R2").id))
    with pytest.raises(errors.UnknownMemberError, match="R1, R2"):
        chain.latest("R9")


def test_check_is_pure() -> None:
    chain = new_chain()
    entry = next_entry(chain)
    head = chain.head
    state = chain.check(*entry)
    assert chain.head == head
    again = chain.check(*entry)
    assert again._replace(table=None) == state._replace(table=None)
    assert again.table.root == state.table.root
    chain.append(*entry)
    assert chain.head == entry.block


def test_several_records_in_one_block() -> None:
    """In order: an enrolment, the new member's first, then two of one robot."""
    chain = new_chain()
    helper = new_chain()
    records = [Enrolment(*chain.operators_next(1), "R3", KEYS["R3"].public).signed(OPERATOR_KEY)]
    helper.append(*entry_of(helper, *records, author=OPERATOR))
    for robot in ("R3", "R1", "R1"):
        entry = next_entry(helper, robot, 2)
        records += entry.records
        helper.append(*entry)
    chain.append(*entry_of(chain, *records, author=OPERATOR))
    assert list(chain.members) == ["R1", "R2", "R3"]
    assert {r: t.sequence for r in chain.members if (t := chain.latest(r))} == {"R1": 1, "R3": 0}
    with pytest.raises(errors.InvalidError):
        new_chain().append(*entry_of(new_chain(), *records[::-1], author=OPERATOR))


def test_a_chain_begins_with_a_genesis_block_only() -> None:
    first = genesis_entry(PUBLIC, OPERATOR_KEY, 5, "test")
    chain = Chain(first)
    assert chain.genesis.insecure
    later = next_entry(chain)
    forged = Entry(first.block, (replace(first.records[0], signature=bytes(64)),))
    by_member = Entry(replace(first.block, author="R1").signed(KEYS["R1"]), first.records)
    high = Entry(replace(first.block, height=1).signed(OPERATOR_KEY), first.records)
    early = Entry(replace(first.block, timestamp_ns=4).signed(OPERATOR_KEY), first.records)
    for bad in (later, forged, by_member, high, early, Entry(first.block, ())):
        with pytest.raises(errors.InvalidError):
            Chain(bad)


def test_two_ledgers_differ_by_salt_name_or_time() -> None:
    ids = {
        genesis_entry(PUBLIC, OPERATOR_KEY, time_ns, name, salt).records[0].id
        for time_ns in (0, 1)
        for name in ("", "a")
        for salt in (b"", b"s")
    }
    assert len(ids) == 8


@pytest.mark.parametrize("name", ["operator", "", "a b", "é"])
def test_names_that_cannot_be_members(name: str) -> None:
    with pytest.raises(errors.RecordError):
        genesis_entry({name: KEYS["R1"].public}, OPERATOR_KEY, 0)


def test_an_expelled_member_is_out_for_ever() -> None:
    chain = two_published()
    late = next_entry(chain, "R1", 40).records[0]
    chain.append(*expulsion(chain, "R1"))
    assert list(chain.members) == ["R2"]
    assert [robot for robot, _ in chain.head.newest] == ["R2"]
    with pytest.raises(errors.ExpelledMemberError, match="expelled R1"):
        chain.latest("R1")
    block, records = next_entry(chain, "R2", 40)
    for entry in (
        entry_of(chain, late, author="R2"),  # its transaction in another's block
        Entry(replace(block, author="R1").signed(KEYS["R1"]), records),  # its block
        expulsion(chain, "R1"),
        enrolment(chain, name="R1"),  # with another key
        enrolment(chain, name="R1", public_key=KEYS["R1"].public),  # or its own
    ):
        with pytest.raises(errors.ExpelledMemberError):
            chain.append(*entry)
    chain.append(*next_entry(chain, "R2", 40, author="R2"))


def test_a_drop_may_name_what_is_not_newest() -> None:
    chain = two_published()
    chain.append(*drop(chain, b"x" * 32, digest(b"payload")))
    assert chain.state.operator_records == 1
    with pytest.raises(errors.RecordError, match="1 to"):
        drop(chain)
