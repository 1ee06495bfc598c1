"""Payloads as files named by the SHA-256 of their bytes: blobs/ab/cdef..."""

import contextlib
import hashlib
from pathlib import Path

from vrchain.ledger.durable import sync_folder, write_durably
from vrchain.ledger.encoding import digest
from vrchain.ledger.errors import DamagedError, NotFoundError


class BlobStore:
    """The blobs of one ledger; ``folder`` is its blobs/ folder, made when first needed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, payload_digest: bytes) -> Path:
        """Where the payload with this digest lies, there or not."""
        name = payload_digest.hex()
        return self.folder / name[:2] / name[2:]

    def put(self, payload_digest: bytes, payload: bytes) -> bool:
        """Make the payload durable; whether it is new here. Raises OSError."""
        path = self.path(payload_digest)
        is_new = not path.exists()
        for folder in (self.folder, path.parent):
            if not folder.exists():
                folder.mkdir(exist_ok=True)
                sync_folder(folder.parent)
        write_durably(path, payload)
        return is_new

    def get(self, payload_digest: bytes) -> bytes:
        """The payload, its digest checked. NotFoundError, DamagedError, or OSError."""
        try:
            payload = self.path(payload_digest).read_bytes()
        except FileNotFoundError:
            raise _missing(payload_digest) from None
        if digest(payload) != payload_digest:
            raise _damaged(payload_digest)
        return payload

    def check(self, payload_digest: bytes) -> None:
        """As ``get``, without holding the bytes."""
        try:
            with open(self.path(payload_digest), "rb") as file:
                found = hashlib.file_digest(file, "sha256").digest()
        except FileNotFoundError:
            raise _missing(payload_digest) from None
        if found != payload_digest:
            raise _damaged(payload_digest)

    def remove(self, payload_digest: bytes) -> None:
        """Take back a payload that no record names."""
        with contextlib.suppress(OSError):
            self.path(payload_digest).unlink(missing_ok=True)


def _missing(payload_digest: bytes) -> NotFoundError:
    return NotFoundError(f"the payload {payload_digest.hex()} is missing")


def _damaged(payload_digest: bytes) -> DamagedError:
    return DamagedError(f"the payload {payload_digest.hex()} has other bytes than were published")
