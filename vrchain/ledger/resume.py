"""Going on from a stored ledger: the head's state, without reading the whole history."""

import sqlite3

from vrchain.ledger.database import checked_record, last_height, read_entry, read_record
from vrchain.ledger.durable import storage_errors
from vrchain.ledger.errors import DamagedError
from vrchain.ledger.keys import PublicKey
from vrchain.ledger.membership import Enrolment, Genesis
from vrchain.ledger.transaction import Transaction
from vrchain.ledger.validity import State, newest_table


def read_state(db: sqlite3.Connection) -> State:
    """The state at the newest block, from the operator's records and the block's own table.

    Every record read is checked against its id, but what came before is not judged again.
    Raises DamagedError, StorageError.
    """
    with storage_errors("reading the head"):
        db.execute("BEGIN")  # one snapshot, whatever others write meanwhile
        try:
            return _read_state(db)
        finally:
            if db.in_transaction:
                db.execute("ROLLBACK")


def _read_state(db: sqlite3.Connection) -> State:
    head = read_entry(db, last_height(db)).block
    genesis, enrolments = _operator_records(db)
    members: dict[str, PublicKey] = dict(genesis.members)
    members.update((record.name, record.public_key) for record in enrolments)
    newest: dict[str, Transaction | None] = dict.fromkeys(members)
    for robot, transaction_id in head.newest:
        record = read_record(db, transaction_id) if any(transaction_id) else None
        newest[robot] = record if isinstance(record, Transaction) else None
    if newest_table(newest) != head.newest:
        raise DamagedError(f"block {head.height} does not go with the stored records; run verify")
    return State(genesis, head, members, newest, len(enrolments))


def _operator_records(db: sqlite3.Connection) -> tuple[Genesis, list[Enrolment]]:
    query = "SELECT id, record FROM records WHERE robot IS NULL ORDER BY height, position"
    records = [checked_record(data, record_id) for record_id, data in db.execute(query)]
    enrolments = [record for record in records if isinstance(record, Enrolment)]
    genesis = records[0] if records else None
    if not isinstance(genesis, Genesis) or len(enrolments) != len(records) - 1:
        raise DamagedError("expected one genesis record, then enrolments; run verify")
    return genesis, enrolments
