"""A replica of the chain in memory: it judges each block and remembers the newest state.

The history itself is the store's; what is here is what the next block is judged by.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from vrchain.ledger.block import NO_BLOCK, Block, Entry, Record
from vrchain.ledger.keys import PublicKey, SigningKey
from vrchain.ledger.membership import OPERATOR, Enrolment, Genesis
from vrchain.ledger.transaction import Transaction
from vrchain.ledger.validity import State, begin, follow, newest_table, unknown_member


def genesis_entry(
    members: Mapping[str, PublicKey],
    operator: SigningKey,
    timestamp_ns: int,
    name: str = "",
    salt: bytes = b"",
) -> Entry:
    """The first block with its genesis record, signed by ``operator``. RecordError on bad names."""
    rows = tuple(sorted(members.items()))
    genesis = Genesis(name, salt, timestamp_ns, operator.public, rows).signed(operator)
    newest = newest_table(dict.fromkeys(members))
    block = Block(0, NO_BLOCK, timestamp_ns, (genesis.id,), newest, OPERATOR)
    return Entry(block.signed(operator), (genesis,))


class Chain:
    """The state after some entries. Start one with the ledger's first entry."""

    def __init__(self, first: Entry) -> None:
        self._state = begin(*first)

    @classmethod
    def at(cls, state: State) -> "Chain":
        """A chain that goes on from a state that the caller vouches for."""
        chain = cls.__new__(cls)
        chain._state = state
        return chain

    @property
    def genesis(self) -> Genesis:
        """The genesis record; its id is the ledger's id."""
        return self._state.genesis

    @property
    def head(self) -> Block:
        """The newest block."""
        return self._state.head

    @property
    def members(self) -> Mapping[str, PublicKey]:
        """Public keys by robot."""
        return MappingProxyType(self._state.members)

    def latest(self, robot: str) -> Transaction | None:
        """The robot's newest transaction, None before its first; UnknownMemberError."""
        try:
            return self._state.newest[robot]
        except KeyError:
            raise unknown_member(robot, self._state.members) from None

    def check(self, block: Block, records: Sequence[Record]) -> State:
        """The state after this block, without going there; an InvalidError if it is refused."""
        return follow(self._state, block, records)

    def advance(self, state: State) -> None:
        """Go to a state that ``check`` gave."""
        self._state = state

    def append(self, block: Block, records: Sequence[Record]) -> None:
        """Take the block in, or raise an InvalidError and stay as before."""
        self.advance(self.check(block, records))

    def draft_transaction(
        self, robot: str, payload_digest: bytes, reason: str, timestamp_ns: int
    ) -> Transaction:
        """The robot's next transaction, not signed yet."""
        last = self.latest(robot)
        sequence = last.sequence + 1 if last else 0
        return Transaction(self.genesis.id, robot, sequence, timestamp_ns, reason, payload_digest)

    def draft_enrolment(self, name: str, public_key: PublicKey, timestamp_ns: int) -> Enrolment:
        """The operator's next enrolment, not signed yet."""
        sequence = self._state.enrolments
        return Enrolment(self.genesis.id, sequence, timestamp_ns, name, public_key)

    def draft_block(self, records: Sequence[Record], author: str) -> Block:
        """The block that brings in ``records`` next, not signed yet.

        Its timestamp is the latest among the head's and the records'.
        """
        newest = dict(self._state.newest)
        for record in records:
            if isinstance(record, Transaction):
                newest[record.robot] = record
            elif isinstance(record, Enrolment):
                newest[record.name] = None
        return Block(
            self.head.height + 1,
            self.head.hash,
            max([self.head.timestamp_ns, *(record.timestamp_ns for record in records)]),
            tuple(record.id for record in records),
            newest_table(newest),
            author,
        )
