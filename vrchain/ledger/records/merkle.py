"""Merkle trees over lists of hashes: one root pins them all, a short path proves one.

The shape is that of RFC 6962: the left half of n leaves are the largest power of two below n.
Leaves and nodes are hashed under domains of their own, so that neither passes for the other.
"""

import hashlib
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from typing import TypeAlias, Union

from vrchain.ledger.records.encoding import DIGEST_BYTES, digest, encode, encode_fields

Path: TypeAlias = tuple[tuple[int, bytes], ...]  # from the leaf up: (1 if on the left, sibling)

EMPTY_ROOT = digest(encode("vrchain/2/empty"))
MAX_PATH = 64  # steps: no tree is as high

# (hash, left, right); a leaf's are None. Nodes never change: trees share those that are alike.
_Node: TypeAlias = tuple[bytes, Union["_Node", None], Union["_Node", None]]

# encode("vrchain/2/node", left, right) has these bytes before its two digests.
_BEFORE_RIGHT = encode_fields(bytes(DIGEST_BYTES))[:-DIGEST_BYTES]
_BEFORE_LEFT = encode("vrchain/2/node") + _BEFORE_RIGHT


class Tree:
    """An unchanging tree over some leaves."""

    __slots__ = ("_size", "_top")

    def __init__(self, leaves: Sequence[bytes]) -> None:
        self._size = len(leaves)
        self._top: _Node = _grown(leaves) if leaves else (EMPTY_ROOT, None, None)

    @property
    def root(self) -> bytes:
        """32 bytes that pin all leaves and their order."""
        return self._top[0]

    def replaced(self, leaves: Mapping[int, bytes]) -> "Tree":
        """The tree with other leaves at some places: new nodes above these only."""
        tree = Tree.__new__(Tree)
        tree._size, tree._top = self._size, self._top
        if leaves:
            tree._top = _replaced(self._top, self._size, 0, sorted(leaves.items()))
        return tree

    def path(self, place: int) -> Path:
        """What ``climb`` needs to come from the leaf at ``place`` to the root."""
        steps: list[tuple[int, bytes]] = []
        (_, left, right), size = self._top, self._size
        while left and right:
            half = _half(size)
            if place < half:
                steps.append((0, right[0]))
                (_, left, right), size = left, half
            else:
                steps.append((1, left[0]))
                (_, left, right), size, place = right, size - half, place - half
        return tuple(reversed(steps))


def climb(leaf: bytes, path: Path) -> bytes:
    """The root that a leaf and its path lead to."""
    for on_the_left, sibling in path:
        leaf = _hash(sibling, leaf) if on_the_left else _hash(leaf, sibling)
    return leaf


def _half(size: int) -> int:
    """How many of ``size`` (at least 2) leaves are on the left."""
    return 1 << (size - 1).bit_length() - 1


def _grown(leaves: Sequence[bytes]) -> _Node:
    if len(leaves) == 1:
        return leaves[0], None, None
    half = _half(len(leaves))
    return _joined(_grown(leaves[:half]), _grown(leaves[half:]))


def _replaced(node: _Node, size: int, start: int, leaves: list[tuple[int, bytes]]) -> _Node:
    """The node of ``size`` leaves from place ``start`` on, with these at their places, sorted."""
    _, left, right = node
    if left is None or right is None:
        return leaves[0][1], None, None
    half = _half(size)
    middle = start + half
    cut = bisect_left(leaves, (middle,))
    if cut:
        left = _replaced(left, half, start, leaves[:cut])
    if cut < len(leaves):
        right = _replaced(right, size - half, middle, leaves[cut:])
    return _joined(left, right)


def _joined(left: _Node, right: _Node) -> _Node:
    return _hash(left[0], right[0]), left, right


def _hash(left: bytes, right: bytes) -> bytes:
    return hashlib.sha256(b"".join((_BEFORE_LEFT, left, _BEFORE_RIGHT, right))).digest()
