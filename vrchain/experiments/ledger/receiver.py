"""Another robot's process: it receives blocks over a local socket and judges them for itself.

What travels is what servers carry too (``ledger.network.message``); the answer is the new head's
hash, or why the block was refused.
"""

import contextlib
import socket
import subprocess
from collections.abc import Mapping
from multiprocessing.connection import Connection

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.child import python
from vrchain.ledger import Entry
from vrchain.ledger.errors import PayloadDigestError
from vrchain.ledger.network.message import MAX_MESSAGE_BYTES, pack_entry, unpack_entry
from vrchain.ledger.rules.chain import Chain
from vrchain.ledger.storage.closing import Closing
from vrchain.ledger.storage.retention import named_by

_HASH_BYTES, _ANSWERS_WITHIN_S = 32, 30.0
_RUN = "import sys; from vrchain.experiments.ledger.receiver import serve; serve(int(sys.argv[1]))"


class Receiver(Closing):
    """A child process with its own replica in memory, which begins with the first block.

    Send it every later block in turn. Use ``with``: leaving ends the child.
    """

    def __init__(self, genesis: Entry) -> None:
        ours, theirs = socket.socketpair()
        self._pipe = Connection(ours.detach())
        with theirs:
            handle = theirs.fileno()
            self._process = python("-c", _RUN, str(handle), keep=[handle])
        try:
            self.send(genesis, {})
        except BaseException:
            self.close()
            raise

    def send(self, entry: Entry, blobs: Mapping[bytes, bytes]) -> bytes:
        """Send a block with its blobs by digest; the child's new head hash, 32 bytes.

        Raises LedgerError with the child's reason if it refuses, or if it does not answer.
        """
        try:
            self._pipe.send_bytes(pack_entry(entry, blobs))
            if not self._pipe.poll(_ANSWERS_WITHIN_S):
                raise TimeoutError(f"nothing within {_ANSWERS_WITHIN_S:g} s")
            answer = self._pipe.recv_bytes()
        except (OSError, EOFError) as error:
            raise LedgerError(f"the other robot's process does not answer: {error}") from None
        if len(answer) != _HASH_BYTES:
            raise LedgerError(f"the other robot refused: {answer[_HASH_BYTES:].decode()}")
        return answer

    def close(self) -> None:
        """End the child; closing twice does no harm."""
        self._pipe.close()
        try:
            self._process.wait(timeout=5)  # it ends when the socket does
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def serve(handle: int) -> None:
    """The child's whole life: judge what comes over the socket ``handle`` until it closes."""
    chain: Chain | None = None
    with Connection(handle) as pipe:
        while True:
            try:
                chain = accept(chain, pipe.recv_bytes(MAX_MESSAGE_BYTES))
                answer = chain.head.hash
            except (OSError, EOFError):
                return  # the sender is gone
            except LedgerError as error:
                answer = bytes(_HASH_BYTES) + f"{type(error).__name__}: {error}".encode()
            with contextlib.suppress(OSError):
                pipe.send_bytes(answer)


def accept(chain: Chain | None, message: bytes) -> Chain:
    """The replica after one message; None is one that has not begun.

    Raises EncodingError, RecordError, PayloadDigestError or an InvalidError kind; then
    ``chain`` is as before.
    """
    (block, records), blobs = unpack_entry(message)
    if chain is None:
        return Chain(Entry(block, records))  # a first block names no blobs
    after = chain.check(block, records)
    if named_by(records) != set(blobs):
        raise PayloadDigestError(f"the blobs are not those that the records of {block} name")
    chain.state = after
    return chain
