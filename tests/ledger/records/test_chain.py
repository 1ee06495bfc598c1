"""Validity: what a replica takes in, and the kind of error for each thing that it refuses."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from ledgers import KEYS, OPERATOR_KEY, PUBLIC, entry_of, new_chain, next_entry

from vrchain.ledger import errors
from vrchain.ledger.records.block import Block, Entry, records_root
from vrchain.ledger.records.encoding import digest
from vrchain.ledger.records.membership import OPERATOR, Drop, Enrolment, Expulsion
from vrchain.ledger.records.table import Table
from vrchain.ledger.records.transaction import NO_TRANSACTION, Transaction
from vrchain.ledger.rules.chain import Chain, genesis_entry
from vrchain.ledger.rules.validity import follow


def two_published() -> Chain:
    """R1 has published twice, R2 never."""
    chain = new_chain()
    chain.append(*next_entry(chain, "R1", 10))
    chain.append(*next_entry(chain, "R1", 20))
    return chain


def changed(chain: Chain, **changes: object) -> Entry:
    """A valid next entry but for these fields of its block, which is signed well."""
    block, records = next_entry(chain, "R1", 30)
    return Entry(replace(block, **changes).signed(KEYS["R1"]), records)  # type: ignore[arg-type]


def transaction(chain: Chain, signer: str = "R1", **changes: object) -> Entry:
    """A valid next entry but for these fields of its transaction."""
    draft = chain.draft("R1", bytes(32), "view", 30)
    return entry_of(chain, replace(draft, **changes).signed(KEYS[signer]))  # type: ignore[arg-type]


def enrolment(chain: Chain, author: str = OPERATOR, signer: str = "", **changes: object) -> Entry:
    draft = Enrolment(*chain.operators_next(30), "R3", KEYS["R3"].public)
    key = KEYS.get(signer, OPERATOR_KEY)
    return entry_of(chain, replace(draft, **changes).signed(key), author=author)  # type: ignore


def again(chain: Chain) -> Entry:
    """The newest transaction once more."""
    latest = chain.latest("R1")
    assert latest is not None
    return entry_of(chain, latest)


def re_signed(chain: Chain, author: str) -> Entry:
    """A block that names one author and is signed by another."""
    block, records = next_entry(chain, "R1", 30)
    return Entry(replace(block, author=author).signed(KEYS["R3"]), records)


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
    second = replace(first, **changes)  # type: ignore[arg-type]
    return entry_of(chain, first.signed(KEYS["R1"]), second.signed(KEYS["R1"]))


REFUSED: dict[str, tuple[type[errors.InvalidError], Callable[[Chain], Entry]]] = {
    "height skipped": (errors.BrokenLinkError, lambda c: changed(c, height=4)),
    "height repeated": (errors.BrokenLinkError, lambda c: changed(c, height=2)),
    "other parent": (errors.BrokenLinkError, lambda c: changed(c, previous_hash=bytes(32))),
    "block before head": (errors.TimeOrderError, lambda c: changed(c, timestamp_ns=19)),
    "block before record": (errors.TimeOrderError, lambda c: changed(c, timestamp_ns=29)),
    "record before last": (errors.TimeOrderError, lambda c: transaction(c, timestamp_ns=19)),
    "replayed": (errors.ReplayError, again),
    "sequence used": (errors.EquivocationError, lambda c: transaction(c, sequence=1)),
    "sequence used long ago": (errors.ReplayError, lambda c: transaction(c, sequence=0)),
    "sequence used by another": (
        errors.SignatureError,
        lambda c: transaction(c, signer="R2", sequence=1),
    ),
    "two with one number": (errors.EquivocationError, lambda c: in_one_block(c, reason="time")),
    "one twice in a block": (errors.ReplayError, in_one_block),
    "other previous": (errors.BrokenLinkError, lambda c: transaction(c, previous=bytes(32))),
    "sequence skipped": (errors.SequenceGapError, lambda c: transaction(c, sequence=3)),
    "signed by another": (errors.SignatureError, lambda c: transaction(c, signer="R2")),
    "in another's name": (
        errors.SignatureError,
        lambda c: transaction(c, signer="R1", robot="R2", sequence=0, previous=NO_TRANSACTION),
    ),
    "not a member": (errors.UnknownMemberError, lambda c: transaction(c, "R3", robot="R3")),
    "of another ledger": (errors.WrongLedgerError, lambda c: transaction(c, ledger_id=bytes(32))),
    "block re-signed": (errors.SignatureError, lambda c: re_signed(c, "R1")),
    "author not a member": (errors.UnknownMemberError, lambda c: re_signed(c, "R3")),
    "author is operator": (errors.SignatureError, lambda c: re_signed(c, OPERATOR)),
    "records not listed": (
        errors.RecordListError,
        lambda c: changed(c, records_root=records_root(())),
    ),
    "records of another": (errors.RecordListError, lambda c: changed(c, records_root=bytes(32))),
    "no records": (
        errors.RecordListError,
        lambda c: entry_of(c),
    ),
    "records missing": (
        errors.RecordListError,
        lambda c: Entry(next_entry(c, "R1", 30).block, ()),
    ),
    "newest not carried": (
        errors.NewestError,
        lambda c: with_newest(c, R1=NO_TRANSACTION),
    ),
    "newest invented": (
        errors.NewestError,
        lambda c: with_newest(c, R3=bytes(32)),
    ),
    "robot left out": (errors.NewestError, lambda c: with_newest(c, "R2")),
    "enrolled by a member": (errors.SignatureError, lambda c: enrolment(c, signer="R1")),
    "enrolled in a member's block": (errors.UnknownMemberError, lambda c: enrolment(c, "R1")),
    "enrolled twice": (errors.DuplicateMemberError, lambda c: enrolment(c, name="R2")),
    "enrolment skipped": (errors.SequenceGapError, lambda c: enrolment(c, sequence=1)),
    "second genesis": (
        errors.RecordListError,
        lambda c: entry_of(c, c.genesis),
    ),
    "expelled by a member": (errors.SignatureError, lambda c: expulsion(c, signer="R1")),
    "expelled in a member's block": (
        errors.UnknownMemberError,
        lambda c: expulsion(c, author="R1"),
    ),
    "expelled who is none": (errors.UnknownMemberError, lambda c: expulsion(c, "R3")),
    "dropped by a member": (errors.SignatureError, lambda c: drop(c, b"x" * 32, signer="R1")),
    "dropped in a member's block": (
        errors.UnknownMemberError,
        lambda c: drop(c, b"x" * 32, author="R1"),
    ),
    "newest dropped": (errors.DropError, lambda c: drop(c, bytes(32), b"x" * 32)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_each_refusal_has_its_kind_and_changes_nothing(name: str) -> None:
    kind, make = REFUSED[name]
    chain = two_published()
    head, latest = chain.head, chain.latest("R1")
    with pytest.raises(errors.InvalidError) as raised:
        chain.append(*make(chain))
    assert type(raised.value) is kind
    assert len(str(raised.value)) > 20
    assert chain.head == head
    assert chain.latest("R1") == latest
    chain.append(*next_entry(chain, "R1", 30))  # and the honest one still passes


def test_a_chain_carries_every_robots_newest() -> None:
    chain = two_published()
    assert chain.head.height == 2
    first = chain.latest("R1")
    assert first is not None and first.sequence == 1
    assert chain.latest("R2") is None
    assert chain.head.newest == (("R1", first.id), ("R2", NO_TRANSACTION))
    chain.append(*next_entry(chain, "R2", 20))  # the same nanosecond is in order
    second = chain.latest("R2")
    assert second is not None
    assert chain.head.newest == (("R1", first.id), ("R2", second.id))
    with pytest.raises(errors.UnknownMemberError, match="R1, R2"):
        chain.latest("R9")


def test_check_is_pure() -> None:
    chain = new_chain()
    entry = next_entry(chain)
    head = chain.head
    state = chain.check(*entry)
    assert chain.head == head
    again = chain.check(*entry)
    assert (again.head, again.newest, again.table.root) == (
        state.head, state.newest, state.table.root
    )  # fmt: skip
    assert chain.head == head
    chain.append(*entry)
    assert chain.head == entry.block


def test_the_operator_enrols_and_the_new_member_publishes() -> None:
    chain = two_published()
    chain.append(*enrolment(chain))
    assert list(chain.members) == ["R1", "R2", "R3"]
    assert chain.latest("R3") is None
    chain.append(*next_entry(chain, "R3", 40))
    assert chain.latest("R3") is not None
    with pytest.raises(errors.DuplicateMemberError):
        chain.append(*enrolment(chain))


def test_several_records_in_one_block() -> None:
    """In order: an enrolment, the new member's first, then two of one robot."""
    chain = new_chain()
    helper = new_chain()
    records = [Enrolment(*chain.operators_next(1), "R3", KEYS["R3"].public).signed(OPERATOR_KEY)]
    helper.append(*entry_of(helper, *records, author=OPERATOR))  # type: ignore[arg-type]
    for robot in ("R3", "R1", "R1"):
        entry = next_entry(helper, robot, 2)
        records += entry.records  # type: ignore[arg-type]
        helper.append(*entry)
    chain.append(*entry_of(chain, *records, author=OPERATOR))  # type: ignore[arg-type]
    assert [(r, t.sequence) for r in chain.members if (t := chain.latest(r))] == [
        ("R1", 1),
        ("R3", 0),
    ]
    with pytest.raises(errors.InvalidError):
        new_chain().append(*entry_of(new_chain(), *records[::-1], author=OPERATOR))  # type: ignore


def test_a_chain_begins_with_a_genesis_block_only() -> None:
    first = genesis_entry(PUBLIC, OPERATOR_KEY, 5, "test")
    chain = Chain(first)
    assert chain.genesis.insecure
    later = next_entry(chain)
    assert isinstance(later.block, Block)
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


def test_equivocation_is_told_with_both_records_as_evidence() -> None:
    chain = two_published()
    first = chain.latest("R1")
    assert first is not None
    forged = transaction(chain, sequence=1)
    with pytest.raises(errors.EquivocationError) as raised:
        chain.append(*forged)
    assert (raised.value.first, raised.value.second) == (first, forged.records[0])
    for evidence in (raised.value.first, raised.value.second):
        assert KEYS["R1"].public.accepts(evidence.body, evidence.signature)


def test_equivocation_with_an_older_number_needs_the_history() -> None:
    chain = new_chain()
    older = next_entry(chain, "R1", 10)
    chain.append(*older)
    chain.append(*next_entry(chain, "R1", 20))
    forged = transaction(chain, sequence=0)
    with pytest.raises(errors.ReplayError):
        chain.append(*forged)

    def earlier(robot: str, sequence: int) -> Transaction | None:
        assert (robot, sequence) == ("R1", 0)
        assert isinstance(older.records[0], Transaction)
        return older.records[0]

    with pytest.raises(errors.EquivocationError) as raised:
        follow(chain.state, *forged, earlier)
    assert raised.value.first == older.records[0]


def test_an_expelled_member_is_out_for_ever() -> None:
    chain = two_published()
    late = next_entry(chain, "R1", 40).records[0]
    chain.append(*expulsion(chain, "R1"))
    assert list(chain.members) == ["R2"]
    assert [robot for robot, _ in chain.head.newest] == ["R2"]
    with pytest.raises(errors.ExpelledMemberError, match="expelled R1"):
        chain.latest("R1")
    refused = [
        entry_of(chain, late, author="R2"),  # its transaction in another's block
        Entry(replace(next_entry(chain, "R2", 40).block, author="R1").signed(KEYS["R1"]), ()),
        expulsion(chain, "R1"),
        enrolment(chain, name="R1"),  # with another key
        enrolment(chain, name="R1", public_key=KEYS["R1"].public),  # or its own
    ]
    refused[1] = Entry(refused[1].block, next_entry(chain, "R2", 40).records)  # its block
    for entry in refused:
        with pytest.raises(errors.ExpelledMemberError):
            chain.append(*entry)
    chain.append(*next_entry(chain, "R2", 40, author="R2"))


def test_a_drop_may_name_what_is_not_newest() -> None:
    chain = two_published()
    chain.append(*drop(chain, b"x" * 32, digest(b"payload")))
    assert chain.state.operator_records == 1
    with pytest.raises(errors.RecordError, match="1 to"):
        drop(chain)
