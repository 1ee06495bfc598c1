"""Another robot's process: it receives blocks over a socket and judges them for itself.

A message (see ``wire``) has these frames: the block, its records, an empty frame, and the blobs of
its transactions in their order. The answer is one frame: ``=`` and the new head's hash, or ``!``
and why the block was refused.
"""

import contextlib
import os
import socket
import subprocess
import sys
from collections.abc import Sequence

from vrchain.errors import LedgerError
from vrchain.ledger.errors import (
    EncodingError,
    PayloadDigestError,
    PeerError,
    PeerRefusedError,
    WireError,
)
from vrchain.ledger.network.wire import receive, send
from vrchain.ledger.records.block import Block, Entry, Record, decode_record
from vrchain.ledger.records.encoding import MAX_PAYLOAD_BYTES, MAX_RECORD_BYTES, digest
from vrchain.ledger.records.transaction import Transaction
from vrchain.ledger.rules.chain import Chain
from vrchain.ledger.storage.closing import Closing
from vrchain.paths import ROOT

MAX_FRAMES = 1 << 16
MAX_MESSAGE_BYTES = MAX_PAYLOAD_BYTES + 16 * MAX_RECORD_BYTES
_MAX_ANSWER_BYTES = 1 << 16
_NO_MORE = b""  # no record is empty
_ACCEPTED, _REFUSED = b"=", b"!"
_PATHS = str(ROOT), os.environ.get("PYTHONPATH")
_RUN = "import sys; from vrchain.ledger.network.peer import serve; serve(int(sys.argv[1]))"


class PeerProcess(Closing):
    """A child process with its own replica, which begins with the ledger's first entry.

    Send it every later block in turn. Use ``with``: leaving ends the child.
    """

    def __init__(self, genesis: Entry, timeout_s: float = 30.0) -> None:
        self._socket, theirs = socket.socketpair()
        self._socket.settimeout(timeout_s)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _RUN, str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, _PATHS))},
                start_new_session=True,  # Ctrl-C is the parent's; the child ends with its socket
            )
        try:
            self.send(*genesis)
        except BaseException:
            self.close()
            raise

    def send(self, block: Block, records: Sequence[Record], *payloads: bytes) -> bytes:
        """Send a block, its records and their blobs; the peer's new head hash, 32 bytes.

        ``payloads``: each transaction's panorama, and its landmark record if it names one.

        Raises PeerRefusedError with the peer's reason, PeerError when it does not answer.
        """
        frames = [block.record, *(r.record for r in records), _NO_MORE, *payloads]
        try:
            send(self._socket, frames)
            answer = receive(self._socket, 1, _MAX_ANSWER_BYTES)
        except OSError as error:
            raise PeerError(f"the peer process does not answer: {error}") from None
        if not answer:
            raise PeerError("the peer process has ended")
        if answer[0][:1] == _REFUSED:
            raise PeerRefusedError(f"the peer refused: {answer[0][1:].decode()}")
        return answer[0][1:]

    def close(self) -> None:
        """End the child; closing twice does no harm."""
        self._socket.close()
        try:
            self._process.wait(timeout=5)  # it ends when the socket does
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def serve(handle: int) -> None:
    """The child's whole life: judge what comes over the socket ``handle`` until it closes."""
    chain: Chain | None = None
    with socket.socket(fileno=handle) as connection:
        while True:
            try:
                if (frames := receive(connection, MAX_FRAMES, MAX_MESSAGE_BYTES)) is None:
                    return
                chain = accept(chain, frames)
                answer = _ACCEPTED + chain.head.hash
            except (OSError, WireError):
                return  # the sender is gone, or what it sends has no frames: nobody to answer
            except LedgerError as error:
                answer = _REFUSED + f"{type(error).__name__}: {error}".encode()
            with contextlib.suppress(OSError):
                send(connection, [answer])


def accept(chain: Chain | None, frames: Sequence[bytes]) -> Chain:
    """The replica after one message's frames; None is one that has not begun.

    Raises EncodingError, RecordError, PayloadDigestError or an InvalidError kind; then
    ``chain`` is as before.
    """
    if _NO_MORE not in frames[1:]:
        raise EncodingError(f"expected a block and its records, got {len(frames)} frames")
    end = frames.index(_NO_MORE, 1)
    block = Block.decode(frames[0])
    records = tuple(decode_record(frame) for frame in frames[1:end])
    named = [blob for record in records if isinstance(record, Transaction) for blob in record.blobs]
    blobs = frames[end + 1 :]
    if len(blobs) != len(named):
        raise PayloadDigestError(f"expected {len(named)} blobs with {block}, got {len(blobs)}")
    if chain is None:
        return Chain(Entry(block, records))  # a genesis record names no blobs
    after = chain.check(block, records)  # before blobs are hashed: it costs less, whatever comes
    if named != [digest(blob) for blob in blobs]:
        raise PayloadDigestError(f"the blobs are not those that the records of {block} name")
    chain.state = after
    return chain
