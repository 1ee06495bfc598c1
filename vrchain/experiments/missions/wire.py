"""What a mission sends over the wire: by the ledger, and if everyone sent all to everyone."""

from vrchain.ledger import Ledger
from vrchain.ledger.records.transaction import NO_BLOB


class Wire:
    """Counts what one robot reads of a ledger."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._read: dict[bytes, int] = {}

    def read(self, digest: bytes) -> bytes:
        """A blob that the driving robot reads, which is sent to it once."""
        blob = self._ledger.payload(digest)
        self._read[digest] = len(blob)
        return blob

    def sent(self, robot: str, n_receivers: int) -> dict[str, float]:
        """published: transactions of all but the driving robot. In megabytes: ledger_mb: landmark
        records to all receivers, panoramas to who read them; broadcast_mb: both to all.
        """
        history = [t for name in self._ledger.robots for t in self._ledger.history(name)]
        panoramas, records = (
            {d: len(self._ledger.payload(d)) for d in digests if d != NO_BLOB}
            for digests in (
                [t.payload_digest for t in history],
                [t.landmarks_digest for t in history],
            )
        )
        to_all = n_receivers * sum(records.values())
        others = {t.payload_digest for t in history if t.robot != robot}
        asked = sum(size for digest, size in self._read.items() if digest in others)
        broadcast = to_all + n_receivers * sum(panoramas.values())
        return {
            "published": sum(t.robot != robot for t in history),
            "ledger_mb": (to_all + asked) / 1e6,
            "broadcast_mb": broadcast / 1e6,
        }
