"""Panoramas and landmark records as files named by the SHA-256 of their bytes: blobs/abcd..."""

import contextlib
import os
import re
from collections.abc import Iterator
from pathlib import Path

from vrchain.ledger.errors import DamagedError, NotFoundError
from vrchain.ledger.records.encoding import MAX_PAYLOAD_BYTES, digest
from vrchain.ledger.storage.durable import TEMPORARY, read_plain, sync_folder, write_whole

_BLOB_NAME = re.compile(r"[0-9a-f]{64}")


class BlobStore:
    """The blobs of one ledger; ``folder`` is its blobs/ folder, made when first needed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._prefix = f"{folder}{os.sep}"

    def path(self, blob: bytes) -> str:
        """Where the blob with this digest lies, there or not."""
        return self._prefix + blob.hex()

    def __contains__(self, blob: bytes) -> bool:
        """Whether there is a file for the blob, good or damaged."""
        return os.path.exists(self.path(blob))

    def put(self, blob: bytes, data: bytes) -> None:
        """Write the blob; ``sync`` makes it, and others with it, durable. Raises OSError."""
        path = self.path(blob)
        try:
            write_whole(path, data)  # if it is there: mends one that was damaged
        except FileNotFoundError:
            self.folder.mkdir()
            sync_folder(self.folder.parent)
            write_whole(path, data)

    def sync(self) -> None:
        """Make what was put durable. Raises OSError."""
        sync_folder(self.folder)

    def get(self, blob: bytes) -> bytes:
        """The blob's bytes, checked against its digest. NotFoundError, DamagedError, or OSError."""
        try:
            data = read_plain(self.path(blob), MAX_PAYLOAD_BYTES)
        except FileNotFoundError:
            raise NotFoundError(f"the payload {blob.hex()} is missing") from None
        if digest(data) != blob:
            raise DamagedError(f"the payload {blob.hex()} has other bytes than were published")
        return data

    def remove(self, blob: bytes) -> None:
        """Take back a blob that no record needs."""
        with contextlib.suppress(OSError):
            os.unlink(self.path(blob))

    def files(self) -> Iterator[tuple[Path, bytes | None]]:
        """Every blob's file with its digest, and None with those that were never finished.

        Files that no ledger writes are passed over.
        """
        for path in sorted(self.folder.glob("*")):
            if path.name.startswith(".") and path.name.endswith(TEMPORARY):
                yield path, None
            elif _BLOB_NAME.fullmatch(path.name):
                yield path, bytes.fromhex(path.name)
