"""Landmarks of many stored panoramas: each is examined once, each pair compared once."""

from collections.abc import Callable

from vrchain.landmarks.common import Comparison, MatchConfig, compare
from vrchain.landmarks.sift import Features, extract
from vrchain.panorama import CameraRig, Panorama


class LandmarkIndex:
    """Features and comparisons by panorama digest.

    read: gives the bytes of a panorama by its digest, for instance a ledger's ``payload``.
    """

    def __init__(self, read: Callable[[bytes], bytes], config: MatchConfig | None = None) -> None:
        self._read = read
        self._config = config or MatchConfig()
        self._features: dict[bytes, tuple[Features, CameraRig]] = {}
        self._compared: dict[tuple[bytes, bytes], Comparison] = {}

    def panorama(self, digest: bytes) -> Panorama:
        """The stored panorama."""
        return Panorama.decode(self._read(digest))

    def features(self, digest: bytes) -> Features:
        """Its keypoints."""
        return self._examined(digest)[0]

    def compare(self, a: bytes, b: bytes) -> Comparison:
        """What two stored panoramas have in common."""
        if (a, b) not in self._compared:
            features_a, rig = self._examined(a)
            self._compared[a, b] = compare(features_a, self.features(b), rig, self._config)
        return self._compared[a, b]

    def compare_with(self, current: Features, rig: CameraRig, b: bytes) -> Comparison:
        """What the panorama in front of the robot has in common with a stored one."""
        return compare(current, self.features(b), rig, self._config)

    def _examined(self, digest: bytes) -> tuple[Features, CameraRig]:
        if digest not in self._features:
            panorama = self.panorama(digest)
            self._features[digest] = extract(panorama), panorama.rig
        return self._features[digest]
