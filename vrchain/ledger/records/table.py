"""The table of every block: each robot's newest transaction, carried over or new.

A block signs the root of the table's Merkle tree. The rows themselves need not be stored with
every block, most being those of the block before: they follow from the records up to it.
"""

from collections.abc import Mapping
from typing import TypeAlias

from vrchain.ledger.records.encoding import digest, encode, encode_fields
from vrchain.ledger.records.merkle import Path, Tree

Rows: TypeAlias = tuple[tuple[str, bytes], ...]

_DOMAIN = encode("vrchain/2/newest")


class Table:
    """An unchanging table. ``newest``: transaction ids by robot, zeros before a robot's first."""

    __slots__ = ("_ids", "_places", "_tree")

    def __init__(self, newest: Mapping[str, bytes]) -> None:
        self._places = {robot: place for place, robot in enumerate(sorted(newest))}
        self._ids = [newest[robot] for robot in self._places]
        self._tree = Tree([leaf_of(robot, newest[robot]) for robot in self._places])

    def __contains__(self, robot: str) -> bool:
        return robot in self._places

    @property
    def rows(self) -> Rows:
        """(robot, id of its newest transaction), sorted by robot."""
        return tuple(zip(self._places, self._ids, strict=True))

    @property
    def root(self) -> bytes:
        """The root of the Merkle tree over the rows, in their order."""
        return self._tree.root

    def replaced(self, newest: Mapping[str, bytes]) -> "Table":
        """The table with other newest transactions of some robots that are in it."""
        table = Table.__new__(Table)
        table._places = self._places  # shared by all tables of these robots
        table._ids = self._ids.copy()
        leaves = {}
        for robot, transaction_id in newest.items():
            place = self._places[robot]
            table._ids[place] = transaction_id
            leaves[place] = leaf_of(robot, transaction_id)
        table._tree = self._tree.replaced(leaves)
        return table

    def path(self, robot: str) -> Path:
        """From the robot's leaf to the root."""
        return self._tree.path(self._places[robot])


def leaf_of(robot: str, transaction_id: bytes) -> bytes:
    """The leaf of a row: its hash, behind a domain of its own."""
    return digest(_DOMAIN + encode_fields(robot, transaction_id))
