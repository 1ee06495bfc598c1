"""How much is taken in, and buckets that hold to it: ``admission`` uses both."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """What is taken in. A robot publishes every few seconds, 200 kB each."""

    record_bytes: int = 2048  # of a transaction that nobody has verified yet
    blob_bytes: int = 1 << 22  # of its panorama and landmark record together
    skew_ns: int = 60_000_000_000  # of a timestamp ahead of the present time
    rate_per_s: float = 1.0  # transactions of one robot, in the long run
    burst: int = 10  # transactions of one robot, at once
    rate_bytes_per_s: float = 1 << 20  # blobs of one robot, in the long run
    burst_bytes: int = 1 << 24  # blobs of one robot, at once
    queue_length: int = 256  # transactions that wait
    queue_bytes: int = 1 << 26  # their blobs
    block_length: int = 64  # transactions in one block
    block_bytes: int = 7_000_000  # of its blobs, so that it travels as one message


# Takes in at any rate: to measure what else holds it up.
UNLIMITED = Limits(rate_per_s=1e6, burst=1 << 20, rate_bytes_per_s=1e12, burst_bytes=1 << 40)


class Bucket:
    """Fills at a rate up to its burst. It may be emptied below nothing: that is paid back first."""

    __slots__ = ("_burst", "_filled_ns", "_rate_per_s", "level")

    def __init__(self, rate_per_s: float, burst: float, now_ns: int, level: float) -> None:
        self._rate_per_s, self._burst = rate_per_s, burst
        self._filled_ns, self.level = now_ns, level

    def fill(self, now_ns: int) -> float:
        """The level now. As a clock is set back nothing is earned; from then on it is again."""
        earned = max(0, now_ns - self._filled_ns) / 1e9 * self._rate_per_s
        self.level, self._filled_ns = min(self.level + earned, self._burst), now_ns
        return self.level

    def take(self, amount: float) -> None:
        """Take something out, whatever there is."""
        self.level -= amount
