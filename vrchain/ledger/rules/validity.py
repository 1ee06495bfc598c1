"""Validity: a pure function of the chain so far and what is to follow.

Nothing here knows a clock, a disk or a rate, so that every replica agrees for ever; what may
be taken in here and now is another question, for ``admission``.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

from vrchain.ledger.errors import (
    BrokenLinkError,
    DropError,
    DuplicateMemberError,
    EquivocationError,
    ExpelledMemberError,
    RecordListError,
    ReplayError,
    SequenceGapError,
    TimeOrderError,
    UnknownMemberError,
    WrongLedgerError,
)
from vrchain.ledger.records.block import NO_BLOCK, Block, Record, records_root
from vrchain.ledger.records.keys import PublicKey
from vrchain.ledger.records.membership import (
    OPERATOR,
    Drop,
    Enrolment,
    Expulsion,
    Genesis,
    OperatorRecord,
)
from vrchain.ledger.records.table import Table
from vrchain.ledger.records.transaction import NO_TRANSACTION, Transaction

Earlier: TypeAlias = Callable[[str, int], Transaction | None]


class State(NamedTuple):
    """All of a chain that the next block is judged by. Nothing in it is ever changed.

    ``newest`` has every member, None for one that has not published yet; ``table`` has their
    ids. ``expelled``: names that were members. ``operator_records``: how many the
    operator has signed after genesis.
    """

    genesis: Genesis
    head: Block
    members: dict[str, PublicKey]
    expelled: frozenset[str]
    newest: dict[str, Transaction | None]
    table: Table
    operator_records: int

    def public_key(self, name: str) -> PublicKey:
        """The key of a member or the operator; UnknownMemberError, ExpelledMemberError."""
        if name == OPERATOR:
            return self.genesis.operator
        try:
            return self.members[name]
        except KeyError:
            raise self.not_a_member(name) from None

    def not_a_member(self, name: str) -> UnknownMemberError:
        """The error for a name that is no member."""
        if name in self.expelled:
            return ExpelledMemberError(f"the operator has expelled {name}; enrol another name")
        known = ", ".join(sorted(self.members)) or "none"
        return UnknownMemberError(
            f"expected a member of the ledger ({known:.400}), got {name!r:.80}; "
            "the operator can enrol it"
        )


def table_of(newest: Mapping[str, Transaction | None]) -> Table:
    """The table of these transactions' ids."""
    return Table({name: last.id if last else NO_TRANSACTION for name, last in newest.items()})


def nothing_earlier(robot: str, sequence: int) -> None:
    """For a chain whose older transactions are not at hand."""


def begin(block: Block, records: Sequence[Record]) -> State:
    """The state after a first block; an InvalidError if it is none."""
    if len(records) != 1 or not isinstance(records[0], Genesis):
        raise RecordListError("expected the first block to bring in one genesis record only")
    genesis = records[0]
    _check_link(block, 0, NO_BLOCK, genesis.timestamp_ns)
    members = dict(genesis.members)
    newest: dict[str, Transaction | None] = dict.fromkeys(members)
    state = State(genesis, block, members, frozenset(), newest, table_of(newest), 0)
    genesis.check_signature(OPERATOR, genesis.operator)
    if block.author != OPERATOR:
        raise UnknownMemberError(f"expected the first block by {OPERATOR}, got {block.author!r}")
    _check_block(block, records, state)
    return state


def follow(
    state: State, block: Block, records: Sequence[Record], earlier: Earlier = nothing_earlier
) -> State:
    """The state after ``block`` with its ``records``; an InvalidError of its own kind if refused.

    ``earlier(robot, sequence)`` finds a transaction of the chain before each robot's newest, so
    that a second one with its number is told as equivocation; without it, as a replay.
    Cheap checks come first, signatures last.
    """
    head = state.head
    _check_link(block, head.height + 1, head.hash, head.timestamp_ns)
    for record in records:
        _check_order(block, block.timestamp_ns, record.timestamp_ns)
    after = take(state, records, block.author, earlier)
    _check_block(block, records, after)
    return after._replace(head=block)


def take(
    state: State, records: Sequence[Record], author: str, earlier: Earlier = nothing_earlier
) -> State:
    """The state with these records taken in, by a block of ``author``'s that is not made yet.

    Its head is still the old one. Raises an InvalidError kind.
    """
    if not records:
        raise RecordListError("expected a block to bring in at least one record, got none")
    published: dict[str, Transaction] = {}  # taken in together: quicker than one by one
    for record in records:
        if isinstance(record, Genesis):
            raise RecordListError(f"expected one genesis record, in block 0, got {record} again")
        if record.ledger_id != state.genesis.id:
            raise WrongLedgerError(
                f"{record} is for the ledger {record.ledger_id.hex()}, "
                f"this one is {state.genesis.id.hex()}"
            )
        if isinstance(record, Transaction):
            robot = record.robot
            if robot not in state.members:
                raise state.not_a_member(robot)
            last = published.get(robot) or state.newest[robot]
            check_transaction(record, state.members[robot], last, earlier)
            published[robot] = record
        else:
            state = _govern(_published(state, published), record, author)
            published = {}
    return _published(state, published)


def check_transaction(
    record: Transaction,
    public: PublicKey,
    last: Transaction | None,
    earlier: Earlier = nothing_earlier,
) -> None:
    """Raise an InvalidError kind unless ``record`` follows ``last``, its robot's newest."""
    expected = last.sequence + 1 if last else 0
    if record.sequence < expected:
        record.check_signature(record.robot, public)  # nobody is accused on a forgery
        newest = last if record.sequence == expected - 1 else None
        first = newest or earlier(record.robot, record.sequence)
        if first and first.body != record.body:
            raise EquivocationError(
                f"{record.robot} signed two transactions with the number {record.sequence}: "
                f"{first.id.hex()} and {record.id.hex()}",
                first,
                record,
            )
    _check_sequence(record, expected)
    if record.previous != (last.id if last else NO_TRANSACTION):
        raise BrokenLinkError(f"{record} does not name the robot's transaction before it")
    if last:
        _check_order(record, record.timestamp_ns, last.timestamp_ns)
    record.check_signature(record.robot, public)


def _check_link(block: Block, height: int, previous_hash: bytes, not_before_ns: int) -> None:
    if block.height != height:
        raise BrokenLinkError(f"expected a block of height {height}, got {block.height}")
    if block.previous_hash != previous_hash:
        raise BrokenLinkError(
            f"expected {block} to follow {previous_hash.hex()}, "
            f"but it follows {block.previous_hash.hex()}"
        )
    _check_order(block, block.timestamp_ns, not_before_ns)


def _check_order(what: Block | Transaction, timestamp_ns: int, not_before_ns: int) -> None:
    if timestamp_ns < not_before_ns:
        raise TimeOrderError(
            f"expected {what} to be no earlier than {not_before_ns} ns, got {timestamp_ns} ns; set "
            "its clock, or if the one before was ahead, expel the robot and enrol it anew"
        )


def _published(state: State, published: Mapping[str, Transaction]) -> State:
    """The state with these as their robots' newest transactions."""
    if not published:
        return state
    table = state.table.replaced({robot: record.id for robot, record in published.items()})
    return state._replace(newest={**state.newest, **published}, table=table)


def _govern(state: State, record: Enrolment | Expulsion | Drop, author: str) -> State:
    if author != OPERATOR:
        raise UnknownMemberError(f"expected {record} in a block by {OPERATOR}, got {author}")
    _check_sequence(record, state.operator_records)
    record.check_signature(OPERATOR, state.genesis.operator)
    match record:
        case Enrolment(name=name) if name in state.members:
            raise DuplicateMemberError(f"{name} is a member already")
        case Enrolment(name=name) if name in state.expelled:
            raise state.not_a_member(name)
        case Expulsion(name=name) if name not in state.members:
            raise state.not_a_member(name)
        case Drop():
            for robot, last in state.newest.items():
                if last and not set(last.blobs).isdisjoint(record.blobs):
                    raise DropError(
                        f"{record} names a blob of {last}, which is the newest of {robot}"
                    )
    after = governed(state, record)
    return after if isinstance(record, Drop) else after._replace(table=table_of(after.newest))


def governed(state: State, record: Record) -> State:
    """The state after the operator's next record, which is not judged here, nor is the table."""
    members, newest, expelled = state.members.copy(), state.newest.copy(), state.expelled
    if isinstance(record, Enrolment):
        members[record.name], newest[record.name] = record.public_key, None
    elif isinstance(record, Expulsion):
        members.pop(record.name, None)
        newest.pop(record.name, None)
        expelled |= {record.name}
    return state._replace(
        members=members,
        expelled=expelled,
        newest=newest,
        operator_records=state.operator_records + 1,
    )


def _check_sequence(record: OperatorRecord | Transaction, expected: int) -> None:
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
    """Whether a block says what its records make of the chain, and who says it."""
    if block.records_root != records_root(records):
        raise RecordListError(f"{block} lists other records than those that came with it")
    block.learn(state.table)
    block.check_signature(block.author, state.public_key(block.author))
