"""Validity: a pure function of the chain so far and what is to follow.

Nothing here knows a clock, a disk or a rate, so that every replica agrees for ever.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from vrchain.ledger.block import NO_BLOCK, NO_TRANSACTION, Block, Entry, Record
from vrchain.ledger.errors import (
    BrokenLinkError,
    DuplicateMemberError,
    NewestError,
    RecordListError,
    ReplayError,
    SequenceGapError,
    TimeOrderError,
    UnknownMemberError,
    WrongLedgerError,
)
from vrchain.ledger.keys import PublicKey
from vrchain.ledger.membership import OPERATOR, Enrolment, Genesis
from vrchain.ledger.transaction import Transaction


@dataclass(frozen=True)
class State:
    """All of a chain that the next block is judged by. Its dicts are never changed.

    ``newest`` has every member, None for one that has not published yet.
    ``enrolments`` counts the operator's records after genesis.
    """

    genesis: Genesis
    head: Block
    members: dict[str, PublicKey]
    newest: dict[str, Transaction | None]
    enrolments: int


def newest_table(newest: dict[str, Transaction | None]) -> tuple[tuple[str, bytes], ...]:
    """A block's table of newest transactions."""
    return tuple(
        (robot, transaction.id if transaction else NO_TRANSACTION)
        for robot, transaction in sorted(newest.items())
    )


def begin(block: Block, records: Sequence[Record]) -> State:
    """The state after a first block; an InvalidError if it is none."""
    if len(records) != 1 or not isinstance(records[0], Genesis):
        raise RecordListError("expected the first block to bring in one genesis record only")
    genesis = records[0]
    _check_link(block, 0, NO_BLOCK, genesis.timestamp_ns)
    members = dict(genesis.members)
    state = State(genesis, block, members, dict.fromkeys(members), 0)
    genesis.check_signature(OPERATOR, genesis.operator)
    _check_block(block, records, state)
    if block.author != OPERATOR:
        raise UnknownMemberError(f"expected the first block by {OPERATOR}, got {block.author!r}")
    return state


def follow(state: State, block: Block, records: Sequence[Record]) -> State:
    """The state after ``block`` with its ``records``; an InvalidError of its own kind if refused.

    Cheap checks come first, signatures last.
    """
    head = state.head
    _check_link(block, head.height + 1, head.hash, head.timestamp_ns)
    if not records:
        raise RecordListError(f"expected {block} to bring in at least one record, got none")
    for record in records:
        state = _take(state, record, block)
    state = State(state.genesis, block, state.members, state.newest, state.enrolments)
    _check_block(block, records, state)
    return state


def start_or_follow(state: State | None, entry: Entry) -> State:
    """``begin`` for the first entry, ``follow`` for every later one."""
    return begin(*entry) if state is None else follow(state, *entry)


def _check_link(block: Block, height: int, previous_hash: bytes, not_before_ns: int) -> None:
    if block.height != height:
        raise BrokenLinkError(f"expected a block of height {height}, got {block.height}")
    if block.previous_hash != previous_hash:
        raise BrokenLinkError(
            f"expected {block} to follow {previous_hash.hex()}, "
            f"but it follows {block.previous_hash.hex()}"
        )
    _check_order(f"{block}", block.timestamp_ns, not_before_ns)


def _check_order(what: str, timestamp_ns: int, not_before_ns: int) -> None:
    if timestamp_ns < not_before_ns:
        raise TimeOrderError(
            f"expected {what} to be no earlier than {not_before_ns} ns, got {timestamp_ns} ns"
        )


def _take(state: State, record: Record, block: Block) -> State:
    if isinstance(record, Genesis):
        raise RecordListError(f"{block} brings in a second genesis record")
    if record.ledger_id != state.genesis.id:
        raise WrongLedgerError(
            f"{record} is for the ledger {record.ledger_id.hex()}, "
            f"this one is {state.genesis.id.hex()}"
        )
    _check_order(f"{block} with {record}", block.timestamp_ns, record.timestamp_ns)
    if isinstance(record, Enrolment):
        return _enrol(state, record, block)
    return _publish(state, record)


def _enrol(state: State, record: Enrolment, block: Block) -> State:
    if record.name in state.members:
        raise DuplicateMemberError(f"{record.name} is a member already")
    if block.author != OPERATOR:
        raise UnknownMemberError(
            f"expected {block} with {record} by {OPERATOR}, got {block.author}"
        )
    _check_sequence(record, state.enrolments)
    record.check_signature(OPERATOR, state.genesis.operator)
    return State(
        state.genesis,
        state.head,
        state.members | {record.name: record.public_key},
        state.newest | {record.name: None},
        state.enrolments + 1,
    )


def _publish(state: State, record: Transaction) -> State:
    robot = record.robot
    if robot not in state.members:
        raise unknown_member(robot, state.members)
    last = state.newest[robot]
    _check_sequence(record, last.sequence + 1 if last else 0)
    if last:
        _check_order(f"{record}", record.timestamp_ns, last.timestamp_ns)
    record.check_signature(robot, state.members[robot])
    newest = state.newest | {robot: record}
    return State(state.genesis, state.head, state.members, newest, state.enrolments)


def _check_sequence(record: Enrolment | Transaction, expected: int) -> None:
    if record.sequence < expected:
        raise ReplayError(
            f"{record}: expected sequence {expected}, got {record.sequence}, which is used"
        )
    if record.sequence > expected:
        raise SequenceGapError(
            f"{record}: expected sequence {expected}, got {record.sequence}; "
            "the ones between are missing"
        )


def _check_block(block: Block, records: Sequence[Record], state: State) -> None:
    if block.records != tuple(record.id for record in records):
        raise RecordListError(f"{block} lists other records than those that came with it")
    if block.newest != newest_table(state.newest):
        raise NewestError(f"{block} has another table of newest transactions than its records make")
    if block.author != OPERATOR and block.author not in state.members:
        raise unknown_member(block.author, state.members)
    public = state.genesis.operator if block.author == OPERATOR else state.members[block.author]
    block.check_signature(block.author, public)


def unknown_member(name: str, members: dict[str, PublicKey]) -> UnknownMemberError:
    """The error for a name that is no member, with the names that are."""
    known = ", ".join(sorted(members)) or "none"
    return UnknownMemberError(
        f"expected a member of the ledger ({known:.400}), got {name!r:.80}; "
        "the operator can enrol it"
    )
