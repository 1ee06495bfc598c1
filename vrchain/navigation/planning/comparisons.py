"""The panoramas of one plan, and what two of them have in common, as far as it was worth asking."""

from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from itertools import combinations, pairwise
from types import MappingProxyType

from vrchain.geometry import Pose, relative
from vrchain.landmarks.matching.common import Comparison
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.navigation.perception import Look
from vrchain.navigation.planning.odometry_links import Track, links, tracks, unbroken
from vrchain.navigation.planning.pair_selection import bridges, partners
from vrchain.navigation.planning.relative_poses import (
    Pair,
    RelativePose,
    RelativePoses,
    pose_from,
)
from vrchain.navigation.planning.reputation import EVEN, reputations
from vrchain.navigation.settings import Published, age_of, panorama_name, robot_of

_BRIDGES = 40  # comparisons, at a plan, beyond the usual ones, if those leave the goal cut off
_UNSURE = (0.05, 0.99)  # a relative pose of such a chance is checked by further comparisons


class Compared:
    """names: the robot's own panoramas, latest first, then the others, oldest first.

    own: of the first; looks: what each shows; found: what two of them, in that order, have in
    common. tracks: those of one robot that its odometry links, which need not be compared.
    reputation: whether a robot is not believed how it moved where pictures contradict it. doubted:
    who was not believed before.
    """

    def __init__(
        self,
        robot: str,
        own: Sequence[tuple[Pose, Look]],
        known: Mapping[str, Published],
        index: LandmarkIndex[Look],
        trust: Callable[[Look, Look, Comparison], float],
        reputation: bool = True,
        doubted: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self.own = tuple(panorama_name(robot, k) for k in range(len(own)))
        times = {n: (p.time_ns, robot_of(n), -age_of(n)) for n, p in known.items()}
        self.names = (*self.own, *sorted(known, key=times.__getitem__))
        self.looks = dict(zip(self.own, (look for _, look in own), strict=True))
        self.looks |= {name: index.look(p.digest) for name, p in known.items()}
        self.found: dict[Pair, Comparison] = {}
        self.tracks = tracks(known, self.looks)
        self._known, self._index, self._trust = known, index, trust
        self._place = {name: k for k, name in enumerate(self.names)}
        stood = tuple(zip(self.own, (pose for pose, _ in own), strict=True))
        self._reputation, self._before = reputation, doubted
        self._ways = {(a, b): relative(p, q) for (a, p), (b, q) in combinations(stood, 2)}
        self._ways |= {(a, b): moved for track in self.tracks for a, b, moved in links(track)}
        self._compared: dict[Pair, RelativePose] = {}
        self._left: list[Pair] = []  # not compared, the likeliest first
        self._bridged = 0
        self._told: RelativePoses | None = None  # these two until something more is compared
        self._heard: tuple[dict[str, float], set[Pair]] | None = None

    def poses(self) -> RelativePoses:
        """The relative poses of panoramas, by all comparisons so far and by odometry."""
        if self._told is None:
            self._told = RelativePoses(self._driven() | self._compared)
        return self._told

    def steps(self) -> list[Pair]:
        """From panorama to panorama of robots that are believed how they moved."""
        others = (pairwise(name for name, _ in track) for track in self._believed())
        return [step for track in (pairwise(self.own), *others) for step in track]

    def _driven(self) -> dict[Pair, RelativePose]:
        """What odometry tells, of robots that are believed."""
        _, denied = self._word()
        part = {name: k for k, track in enumerate(self._believed()) for name, _ in track}
        part |= dict.fromkeys(self.own, -1)
        return {
            (a, b): RelativePose(moved, 1.0)
            for (a, b), moved in self._ways.items()
            if a in part and part[a] == part.get(b) and (a, b) not in denied
        }

    def _believed(self) -> list[Track]:
        """The tracks of robots that are believed, without the steps that pictures deny."""
        doubted, denied = self._word()
        known = (track for track in self.tracks if robot_of(track[0][0]) not in doubted)
        return [part for track in known for part in unbroken(track, denied)]

    def doubted(self) -> dict[str, float]:
        """Robots whose word of their own way pictures contradict, and the share that agrees."""
        return self._word()[0]

    def _word(self) -> tuple[dict[str, float], set[Pair]]:
        """Whose word of its way is not believed, and which links of others' ways are not."""
        if not self._reputation:
            return {}, set()
        if self._heard is None:
            shares, denied = reputations(self._compared, self.tracks)
            now = {robot: share for robot, share in shares.items() if share < EVEN}
            self._heard = {**self._before, **now}, denied
        return self._heard

    def _compare(self, a: str, b: str) -> float:
        """Compare two, in their order: the chance that their relative pose is right."""
        digest = self._known[b].digest
        if a in self.own:
            found = self._index.compare_with(self.looks[a], digest)
        else:
            found = self._index.compare(self._known[a].digest, digest)
        trust = self._trust(self.looks[a], self.looks[b], found) if found.common else 0.0
        self.found[a, b] = found
        self._compared[a, b] = RelativePose(pose_from(found, self.looks[a].rig), trust)
        self._told = self._heard = None
        return trust

    def compare_likely(self, alike: Callable[[Look, Look], float], seers: Set[str]) -> None:
        """Those that are likely to have something in common; more, if that leaves seers cut off."""
        pairs = [pair for pair in combinations(self.names, 2) if pair[1] not in self.own]
        pairs.sort(key=lambda pair: -alike(self.looks[pair[0]], self.looks[pair[1]]))
        driven = self._driven()
        for pair in partners(self.names, pairs):
            if pair not in driven and pair not in self._compared:
                self._compare(*pair)
        self._left = [pair for pair in pairs if pair not in self._compared]
        self.bridge(seers)

    def bridge(self, seers: Set[str]) -> bool:
        """Compare what may join those that see the goal to the robot's own; False: nothing may."""
        if not seers or self._bridged >= _BRIDGES:
            return False
        poses = self.poses()
        rights = {pair: poses.trust(pair) for pair in (*self._driven(), *self._compared)}
        left = [pair for pair in self._left if pair not in rights]
        before, asked = self._index.n_compared, False
        for pair in bridges(self.names, left, rights, set(self.own), seers):
            asked, rights[pair] = True, self._compare(*pair)
            self._bridged += self._index.n_compared - before
            before = self._index.n_compared
            if self._bridged >= _BRIDGES:
                break
        return asked

    def check(self, pairs: Iterable[Pair]) -> bool:
        """Compare what tells more of pairs that are unsure; False if there is nothing to ask."""
        poses = self.poses()
        in_order = [self._in_order(*pair) for pair in pairs]
        unsure = [
            p for p in in_order if p in self.found and _UNSURE[0] < poses.trust(p) < _UNSURE[1]
        ]
        asked = {self._in_order(*other) for pair in unsure for other in poses.unasked(pair)}
        for pair in sorted(asked):
            self._compare(*pair)
        return bool(asked)

    def _in_order(self, a: str, b: str) -> Pair:
        """The two in the order of ``names``."""
        return (a, b) if self._place[a] < self._place[b] else (b, a)
