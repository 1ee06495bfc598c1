"""What many stored panoramas show: each is looked at once, each pair compared once."""

from collections.abc import Callable
from typing import Generic, TypeVar

from vrchain.landmarks.matching.common import Comparison
from vrchain.panorama import CameraRig, Panorama

Look = TypeVar("Look")


class LandmarkIndex(Generic[Look]):
    """Looks and comparisons by what names a panorama, such as its digest.

    read: gives the bytes of a panorama, for instance a ledger's ``payload``.
    described: the landmark record that was published with it, or None. look: what is made of both;
    compare: what two looks have in common.
    """

    def __init__(
        self,
        read: Callable[[bytes], bytes],
        described: Callable[[bytes], bytes | None],
        look: Callable[[bytes, bytes | None], Look],
        compare: Callable[[Look, Look], Comparison],
    ) -> None:
        self._read, self._described = read, described
        self._make, self._compare = look, compare
        self._rigs: dict[bytes, CameraRig] = {}
        self._looks: dict[bytes, Look] = {}
        self._compared: dict[tuple[bytes, bytes], Comparison] = {}
        self._with: dict[tuple[int, bytes], tuple[Look, Comparison]] = {}  # kept: so is its id

    @property
    def n_compared(self) -> int:
        """How many pairs were compared so far."""
        return len(self._compared) + len(self._with)

    def panorama(self, digest: bytes) -> Panorama:
        """The stored panorama."""
        return Panorama.decode(self._read(digest))

    def is_by(self, rig: CameraRig, digest: bytes) -> bool:
        """Whether a stored panorama says it is of these cameras: no other is worth opening."""
        if digest not in self._rigs:
            self._rigs[digest] = Panorama.rig_of(self._read(digest))
        return self._rigs[digest] == rig

    def look(self, digest: bytes) -> Look:
        """What it shows."""
        if digest not in self._looks:
            self._looks[digest] = self._make(self._read(digest), self._described(digest))
        return self._looks[digest]

    def compare(self, a: bytes, b: bytes) -> Comparison:
        """What two stored panoramas have in common."""
        if (a, b) not in self._compared:
            self._compared[a, b] = self._compare(self.look(a), self.look(b))
        return self._compared[a, b]

    def compare_with(self, current: Look, b: bytes) -> Comparison:
        """What the panorama in front of the robot has in common with a stored one."""
        key = id(current), b
        if key not in self._with:
            self._with[key] = current, self._compare(current, self.look(b))
        return self._with[key][1]
