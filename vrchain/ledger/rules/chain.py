"""A replica of the chain: it judges each block, makes the next one, and knows the newest state.

The history itself is the store's; what is here is what the next block is judged by.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TypeAlias

from vrchain.ledger.errors import RecordError, SignatureError
from vrchain.ledger.records.block import NO_BLOCK, Block, Entry, Record, records_root
from vrchain.ledger.records.keys import PublicKey, SigningKey
from vrchain.ledger.records.membership import OPERATOR, Genesis
from vrchain.ledger.records.transaction import NO_BLOB, NO_TRANSACTION, Transaction
from vrchain.ledger.rules.validity import State, begin, follow, table_of, take

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


class Replica:
    """What is known of a chain up to its newest block: ``Chain`` in memory, ``Ledger`` on disk."""

    state: State

    @property
    def genesis(self) -> Genesis:
        """The genesis record; its id is the ledger's id."""
        return self.state.genesis

    @property
    def head(self) -> Block:
        """The newest block that is known here."""
        return self.state.head

    @property
    def members(self) -> Mapping[str, PublicKey]:
        """Public keys by robot."""
        return MappingProxyType(self.state.members)

    @property
    def expelled(self) -> frozenset[str]:
        """Names that were members; none of them comes back."""
        return self.state.expelled

    @property
    def robots(self) -> tuple[str, ...]:
        """The members' names, sorted."""
        return tuple(sorted(self.state.members))

    def latest(self, robot: str) -> Transaction | None:
        """The robot's newest transaction that is known here, None before its first.

        Raises UnknownMemberError, ExpelledMemberError.
        """
        try:
            return self.state.newest[robot]
        except KeyError:
            raise self.state.not_a_member(robot) from None

    def check(self, block: Block, records: Sequence[Record]) -> State:
        """The state after this block, without going there; an InvalidError if it is refused."""
        return follow(self.state, block, records, self._earlier)

    def make(
        self,
        records: Sequence[Record],
        author: str,
        key: SigningKey,
        lap: Lap = lambda stage: None,
    ) -> tuple[Entry, State]:
        """The next block, which brings in ``records``, signed by ``key``, and the state after it.

        The replica stays where it is. The block's timestamp is the latest among the head's and the
        records'. ``lap(stage)`` is called after validate, encode and sign. Raises an InvalidError
        kind.
        """
        head = self.state.head
        after = take(self.state, records, author, self._earlier)
        if after.public_key(author).raw != key.public.raw:
            raise SignatureError(f"expected the key of {author} to sign a block with, got another")
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

    def draft(
        self,
        robot: str,
        payload_digest: bytes,
        reason: str,
        timestamp_ns: int,
        landmarks_digest: bytes = NO_BLOB,
    ) -> Transaction:
        """The robot's next transaction, for blobs with these digests, not signed yet."""
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

    def operators_next(self, timestamp_ns: int) -> tuple[bytes, int, int]:
        """What the operator's next record begins with: ledger id, sequence, ``timestamp_ns``."""
        return self.genesis.id, self.state.operator_records, timestamp_ns

    def _earlier(self, robot: str, sequence: int) -> Transaction | None:
        """A transaction that is no longer its robot's newest, where it is at hand."""
        return None


class Chain(Replica):
    """A chain in memory, which begins with the ledger's first entry."""

    def __init__(self, first: Entry) -> None:
        self.state = begin(*first)

    def append(self, block: Block, records: Sequence[Record]) -> None:
        """Take the block in, or raise an InvalidError and stay as before."""
        self.state = self.check(block, records)
