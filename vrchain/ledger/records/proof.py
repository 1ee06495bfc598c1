"""A short proof that a transaction is its robot's newest, for one who knows the head's hash only.

The block's signed part is a few hundred bytes; from the transaction's row of the table to the
root in that part it is one hash for each doubling of the number of robots.
"""

from dataclasses import dataclass

from vrchain.ledger.errors import EncodingError, ProofError, RecordError
from vrchain.ledger.records.block import Block
from vrchain.ledger.records.encoding import check_kinds, decode, digest, encode
from vrchain.ledger.records.fields import check_digest
from vrchain.ledger.records.merkle import MAX_PATH, Path, climb
from vrchain.ledger.records.table import leaf_of
from vrchain.ledger.records.transaction import Transaction

DOMAIN = "vrchain/2/proof"


@dataclass(frozen=True)
class Proof:
    """``block``: canonical bytes of a block. ``path``: see ``merkle.climb``."""

    block: bytes
    path: Path

    def __post_init__(self) -> None:
        if len(self.path) > MAX_PATH:
            raise RecordError(f"proof: expected at most {MAX_PATH} steps, got {len(self.path)}")
        for side, sibling in self.path:
            if side not in (0, 1):
                raise RecordError(f"proof: expected a side of 0 or 1, got {side}")
            check_digest("proof's sibling", sibling)

    def climbed(self, transaction: Transaction) -> list[bytes]:
        """The hashes from the transaction's row up to the root: one more than there are steps."""
        row = leaf_of(transaction.robot, transaction.id)
        return [climb(row, self.path[:steps]) for steps in range(len(self.path) + 1)]

    def encode(self) -> bytes:
        """Canonical bytes, to send."""
        return encode(DOMAIN, self.block, self.path)

    @classmethod
    def decode(cls, data: bytes) -> "Proof":
        """What ``encode`` gave; EncodingError, RecordError or TooLargeError for other bytes."""
        block, path = check_kinds("proof", decode(data, DOMAIN), bytes, tuple)
        for step in path:
            if type(step) is not tuple:
                raise EncodingError(f"proof: expected steps, got {type(step).__name__}")
            check_kinds("step of a proof", step, int, bytes)
        return cls(block, path)


def verify_proof(head_hash: bytes, transaction: Transaction, proof: Proof) -> None:
    """Raise ProofError unless ``proof`` shows the transaction in the table of that head.

    That it is signed is for the block's judges: who trusts the head's hash trusts them. Raises
    EncodingError or RecordError when what the hash stands for is no block.
    """
    if digest(proof.block) != head_hash:
        raise ProofError(f"expected a proof for the head {head_hash.hex()}, got one for another")
    block = Block.decode(proof.block)
    if climb(leaf_of(transaction.robot, transaction.id), proof.path) != block.newest_root:
        raise ProofError(f"the proof does not lead from {transaction} to {block}")
