"""A replica of the chain in memory: it judges each block and remembers the newest state.

The history itself is the store's; what is here is what the next block is judged by.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TypeAlias

from vrchain.ledger.errors import RecordError
from vrchain.ledger.records.block import NO_BLOCK, Block, Entry, Record, records_root
from vrchain.ledger.records.keys import PublicKey, SigningKey
from vrchain.ledger.records.membership import OPERATOR, Drop, Enrolment, Expulsion, Genesis
from vrchain.ledger.records.transaction import NO_BLOB, NO_TRANSACTION, Transaction
from vrchain.ledger.rules.validity import (
    Earlier,
    State,
    begin,
    check_author,
    follow,
    nothing_earlier,
    table_of,
    take,
)

Lap: TypeAlias = Callable[[str], object]


def genesis_entry(
    members: Mapping[str, PublicKey],
    operator: SigningKey,
    timestamp_ns: int,
    name: str = "",
    salt: bytes = b"",
) -> Entry:
    """The first block with its genesis record, signed by ``operator``. RecordError on bad names."""
    check_new_name(name)
    rows = tuple(sorted(members.items()))
    genesis = Genesis(name, salt, timestamp_ns, operator.public, rows).signed(operator)
    table = table_of(dict.fromkeys(members))
    root = records_root((genesis,))
    block = Block(0, NO_BLOCK, timestamp_ns, root, table.root, OPERATOR, table)
    return Entry(block.signed(operator), (genesis,))


def check_new_name(name: str) -> None:
    """Refuse with RecordError what could fake lines on a screen. Old ledgers keep their names."""
    if not name.isprintable():
        raise RecordError(f"ledger name: expected printable characters, got {name!a:.80}")


class Chain:
    """The state after some entries. Start one with the ledger's first entry.

    ``earlier`` finds transactions that are no longer the newest, where they are at hand.
    """

    def __init__(self, first: Entry) -> None:
        self.state = begin(*first)
        self._earlier: Earlier = nothing_earlier

    @classmethod
    def at(cls, state: State, earlier: Earlier) -> "Chain":
        """A chain that goes on from a state that the caller vouches for."""
        chain = cls.__new__(cls)
        chain.state, chain._earlier = state, earlier
        return chain

    @property
    def genesis(self) -> Genesis:
        """The genesis record; its id is the ledger's id."""
        return self.state.genesis

    @property
    def head(self) -> Block:
        """The newest block."""
        return self.state.head

    @property
    def members(self) -> Mapping[str, PublicKey]:
        """Public keys by robot."""
        return MappingProxyType(self.state.members)

    def latest(self, robot: str) -> Transaction | None:
        """The robot's newest transaction, None before its first; UnknownMemberError."""
        try:
            return self.state.newest[robot]
        except KeyError:
            raise self.state.not_a_member(robot) from None

    def check(self, block: Block, records: Sequence[Record]) -> State:
        """The state after this block, without going there; an InvalidError if it is refused."""
        return follow(self.state, block, records, self._earlier)

    def append(self, block: Block, records: Sequence[Record]) -> None:
        """Take the block in, or raise an InvalidError and stay as before."""
        self.state = self.check(block, records)

    def make(
        self,
        records: Sequence[Record],
        author: str,
        key: SigningKey,
        lap: Lap = lambda stage: None,
    ) -> tuple[Entry, State]:
        """The next block, which brings in ``records``, signed by ``key``, and the state after it.

        The chain stays where it is. The block's timestamp is the latest among the head's and the
        records'. ``lap(stage)`` is called after validate, encode and sign. Raises an InvalidError
        kind.
        """
        head = self.state.head
        after = take(self.state, records, author, self._earlier)
        check_author(after, author, key.public)  # the block's own signature need not be, then
        lap("validate")
        draft = Block(
            head.height + 1,
            head.hash,
            max([head.timestamp_ns, *(record.timestamp_ns for record in records)]),
            records_root(records),
            after.table.root,
            author,
            after.table,
        )
        assert draft.body
        lap("encode")
        block = draft.signed(key)
        lap("sign")
        return Entry(block, tuple(records)), after._replace(head=block)

    def draft_transaction(
        self,
        robot: str,
        payload_digest: bytes,
        reason: str,
        timestamp_ns: int,
        landmarks_digest: bytes = NO_BLOB,
    ) -> Transaction:
        """The robot's next transaction, not signed yet."""
        last = self.latest(robot)
        return Transaction(
            self.genesis.id,
            robot,
            last.sequence + 1 if last else 0,
            timestamp_ns,
            reason,
            payload_digest,
            landmarks_digest,
            last.id if last else NO_TRANSACTION,
        )

    def draft_enrolment(self, name: str, public_key: PublicKey, timestamp_ns: int) -> Enrolment:
        """The operator's next record, an enrolment, not signed yet."""
        return Enrolment(*self._operators_next(timestamp_ns), name, public_key)

    def draft_expulsion(self, name: str, timestamp_ns: int) -> Expulsion:
        """The operator's next record, an expulsion, not signed yet."""
        return Expulsion(*self._operators_next(timestamp_ns), name)

    def draft_drop(self, blobs: Sequence[bytes], timestamp_ns: int) -> Drop:
        """The operator's next record, a drop of these blobs, not signed yet."""
        return Drop(*self._operators_next(timestamp_ns), tuple(sorted(set(blobs))))

    def _operators_next(self, timestamp_ns: int) -> tuple[bytes, int, int]:
        return self.genesis.id, self.state.operator_records, timestamp_ns
