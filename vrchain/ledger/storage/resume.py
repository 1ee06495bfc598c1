"""Going on from a stored ledger, without judging the whole history again."""

import sqlite3
from collections.abc import Iterator

from vrchain.errors import LedgerError
from vrchain.ledger.errors import DamagedError, InvalidError
from vrchain.ledger.records.block import Block, Entry, Record, records_root
from vrchain.ledger.records.membership import OPERATOR, Enrolment, Expulsion, Genesis
from vrchain.ledger.records.table import Table
from vrchain.ledger.records.transaction import NO_TRANSACTION, Transaction
from vrchain.ledger.rules.validity import State, governed, table_of
from vrchain.ledger.storage.database import (
    last_height,
    newest_transaction,
    operator_records,
    read_entries,
    read_record,
    read_records,
)
from vrchain.ledger.storage.durable import storage_errors


def read_state(db: sqlite3.Connection) -> State:
    """The state at the newest block.

    Every record read is checked against its id, what they come to against the block's root, and
    the signatures of all that the state rests on: the head, the newest transactions, the
    operator's records. What came before is not judged again. Raises DamagedError, StorageError.
    """
    with storage_errors("reading the head"):
        db.execute("BEGIN")  # one snapshot, whatever others write meanwhile
        try:
            height = last_height(db)
            state = _state_at(db, height)
            by_operator = operator_records(db, height)
        finally:
            if db.in_transaction:
                db.execute("ROLLBACK")
    try:
        for record in by_operator:
            record.check_signature(OPERATOR, state.genesis.operator)
        for robot, last in state.newest.items():
            if last:
                last.check_signature(robot, state.members[robot])
        state.head.check_signature(state.head.author, state.public_key(state.head.author))
    except InvalidError as error:
        raise DamagedError(f"{error}; run verify") from None
    return state


def read_whole_entries(db: sqlite3.Connection, start: int, stop: int) -> Iterator[Entry]:
    """As ``read_entries``, each block with its table, and both roots checked. DamagedError too."""
    table: Table | None = None
    for block, records in read_entries(db, start, stop):
        table = _table_after(table, records) if table else _state_at(db, block.height).table
        _learn(block, table)
        if records_root(records) != block.records_root:
            raise DamagedError(f"{block} lists other records than are stored; run verify")
        yield Entry(block, records)


def read_history(db: sqlite3.Connection, robot: str, height: int) -> list[Transaction]:
    """The robot's transactions up to the block at ``height``, each naming the one before it.

    Raises DamagedError, also where a spoilt tree of rows leads round in a circle.
    """
    found: list[Transaction] = []
    condition = "robot = ? AND height <= ?"
    for record in read_records(db, f"the history of {robot}", condition, (robot, height)):
        expected = robot, len(found), found[-1].id if found else NO_TRANSACTION
        if not isinstance(record, Transaction) or expected != (
            record.robot,
            record.sequence,
            record.previous,
        ):
            raise DamagedError(f"the history of {robot} is not whole; run verify")
        found.append(record)
    return found


def first_unreadable(db: sqlite3.Connection, blocks: int) -> int | None:
    """The lowest of so many good blocks that a reader cannot find by the indexes, None if none."""
    for height in range(blocks):
        try:
            (entry,) = read_whole_entries(db, height, height + 1)
            for record in entry.records:
                read_record(db, record.id)
        except LedgerError:
            return height
    return None


def _table_after(table: Table, records: tuple[Record, ...]) -> Table:
    for record in records:
        match record:
            case Transaction() if record.robot in table:
                table = table.replaced({record.robot: record.id})
            case Enrolment():
                table = Table({**dict(table.rows), record.name: NO_TRANSACTION})
            case Expulsion():
                table = Table({row[0]: row[1] for row in table.rows if row[0] != record.name})
            case _:
                pass  # the root will tell whether that is right
    return table


def _learn(block: Block, table: Table) -> None:
    try:
        block.learn(table)
    except InvalidError as error:
        raise DamagedError(f"{error}; run verify") from None


def _state_at(db: sqlite3.Connection, height: int) -> State:
    head = next(read_entries(db, height, height + 1)).block
    records = operator_records(db, height)
    if not records or not isinstance(records[0], Genesis):
        raise DamagedError("expected a genesis record before all others; run verify")
    genesis = records[0]
    state = State(genesis, head, dict(genesis.members), frozenset(), {}, Table({}), 0)
    for record in records[1:]:
        state = governed(state, record)
    newest = {robot: newest_transaction(db, robot, height) for robot in state.members}
    state = state._replace(newest=newest, table=table_of(newest))
    _learn(head, state.table)
    return state
