"""Messages over a connection, however the bytes come apart, and whatever bytes they are."""

import socket

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ledgers import garbage

from vrchain.errors import LedgerError
from vrchain.ledger.errors import TooLargeError, WireError
from vrchain.ledger.network.wire import Reader, pack, receive, send

MAX_FRAMES, MAX_BYTES = 4, 200
messages = st.lists(st.binary(max_size=40), max_size=MAX_FRAMES)


class Pieces:
    """Stands for a connection that gives its bytes in small pieces."""

    def __init__(self, data: bytes, at_most: int = 7) -> None:
        self._rest, self._at_most = data, at_most

    def recv_into(self, buffer: memoryview) -> int:
        piece = self._rest[: min(self._at_most, len(buffer))]
        buffer[: len(piece)] = piece
        self._rest = self._rest[len(piece) :]
        return len(piece)


def read(data: bytes, at_most: int = 7) -> list[list[bytes] | None]:
    """All messages in ``data``."""
    found = []
    connection, reader = Pieces(data, at_most), Reader(MAX_FRAMES, MAX_BYTES)
    while reader.read(connection, 1 << 20):
        if reader.whole:
            found.append(reader.next())
    return found


@given(st.lists(messages, max_size=4), st.integers(1, 100))
def test_messages_come_as_they_were_sent(sent: list[list[bytes]], at_most: int) -> None:
    assert read(b"".join(map(pack, sent)), at_most) == sent


@given(st.lists(st.binary(max_size=MAX_BYTES), min_size=1, max_size=MAX_FRAMES), messages)
def test_what_is_too_large_is_none_and_the_next_one_is_read(
    sent: list[bytes], after: list[bytes]
) -> None:
    expected = sent if sum(map(len, sent)) <= MAX_BYTES else None
    assert read(pack(sent) + pack(after)) == [expected, after]


def test_through_a_socket() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        for frames in ([], [b""], [b"a", bytes(1000)]):
            send(ours, frames)
            assert receive(theirs, 2, 1001) == frames
        send(ours, [bytes(1002)])
        send(ours, [b"next"])
        with pytest.raises(TooLargeError):
            receive(theirs, 2, 1001)
        assert receive(theirs, 2, 1001) == [b"next"]
        send(ours, [b""] * 3)
        with pytest.raises(WireError):
            receive(theirs, 2, 1001)


@pytest.mark.parametrize("begun", [b"", b"\0\0", pack([b"", b"frame"])[:-1]])
def test_a_connection_that_ends_is_no_message(begun: bytes) -> None:
    ours, theirs = socket.socketpair()
    with theirs:
        ours.sendall(begun)
        ours.close()
        assert receive(theirs, 2, 100) is None


@pytest.mark.parametrize("count", [500, pytest.param(100_000, marks=pytest.mark.slow)])
def test_garbage_raises_only_the_ledgers_own_errors(count: int) -> None:
    good = [pack([b"record", b"payload"]), pack([b"=" + bytes(32), bytes(32)]), pack([b"!no", b""])]
    refused = 0
    for data in garbage(count, good):
        try:
            read(data, at_most=1 << 20)
        except LedgerError:
            refused += 1
    assert refused > 0.3 * count
