"""Messages over a socket: a count of frames, then each frame behind its length.

Count and lengths are 4 bytes each, big-endian. Limits are held before anything is kept.
"""

import socket
from collections.abc import Generator, Sequence

from vrchain.ledger.errors import TooLargeError, WireError

_COUNT_BYTES = 4
_SKIPPED_BYTES = 1 << 16

Message = list[bytes] | None
"""A message's frames; None for one with more bytes than are taken, of which none was kept."""


def pack(frames: Sequence[bytes]) -> bytes:
    """The bytes of one message."""
    parts = [_count(len(frames))]
    for frame in frames:
        parts += (_count(len(frame)), frame)
    return b"".join(parts)


def send(connection: socket.socket, frames: Sequence[bytes]) -> None:
    """Send one message. OSError."""
    connection.sendall(pack(frames))


def receive(connection: socket.socket, max_frames: int, max_bytes: int) -> list[bytes] | None:
    """The next message's frames, None at the end of the connection.

    Raises TooLargeError for one of more bytes once it is past: the next may follow. Raises
    WireError for one of more frames, after which nothing can; OSError.
    """
    reader = Reader(max_frames, max_bytes)
    while not reader.whole:
        if not reader.read(connection, max_bytes):
            return None
    message = reader.next()
    if message is None:
        raise TooLargeError(f"expected a message of at most {max_bytes} bytes")
    return message


class Reader:
    """Puts messages together from what a socket gives, one after another."""

    def __init__(self, max_frames: int, max_bytes: int) -> None:
        self._limits = max_frames, max_bytes
        self._message: Message = None
        self._begin()

    def read(self, connection: socket.socket, at_most: int) -> int:
        """Take some bytes, none of the message after; how many, 0 at the connection's end.

        ``whole`` is true once a message is. Raises WireError for too many frames; OSError.
        """
        count = connection.recv_into(memoryview(self._part)[self._done : self._done + at_most])
        self._done += count
        if self._done == len(self._part):
            self._advance(bytes(self._part))
        return count

    def next(self) -> Message:
        """The whole message; then it reads the next one."""
        message = self._message
        self._begin()
        return message

    def _begin(self) -> None:
        self._parser = _parse(*self._limits)
        self.whole = False
        self._expect(next(self._parser))

    def _advance(self, part: bytes) -> None:
        try:
            self._expect(self._parser.send(part))
        except StopIteration as end:
            self.whole, self._message = True, end.value

    def _expect(self, count: int) -> None:
        self._part, self._done = bytearray(count), 0


def _parse(max_frames: int, max_bytes: int) -> Generator[int, bytes, Message]:
    """Asks for so many bytes at a time and is sent them; never for none."""
    count = int.from_bytes((yield _COUNT_BYTES), "big")
    if count > max_frames:
        raise WireError(f"expected at most {max_frames} frames, got {count}")
    frames: list[bytes] = []
    room = max_bytes
    for _ in range(count):
        length = int.from_bytes((yield _COUNT_BYTES), "big")
        room -= length
        if room >= 0:
            frames.append((yield length) if length else b"")
        else:
            frames.clear()
            for start in range(0, length, _SKIPPED_BYTES):
                yield min(_SKIPPED_BYTES, length - start)
    return frames if room >= 0 else None


def _count(number: int) -> bytes:
    return number.to_bytes(_COUNT_BYTES, "big")
