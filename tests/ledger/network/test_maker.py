"""Makers that come upon each other: what one has made a block of, another does not refuse."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from clusters import PATIENCE_S, making, skip_without_servers
from ledgers import KEYS, small_ledger

from vrchain.ledger import Ledger, Offer
from vrchain.ledger.cluster.servers import Cluster
from vrchain.ledger.network.connection import Connection, Servers
from vrchain.ledger.network.log import FolderLog, put
from vrchain.ledger.network.maker import Maker
from vrchain.ledger.network.message import pack_offer
from vrchain.ledger.network.offers import Waiting
from vrchain.ledger.network.opening import open_ledger
from vrchain.ledger.network.replicated import Replicated
from vrchain.ledger.network.robot import RobotLedger
from vrchain.ledger.network.stream import Stream
from vrchain.ledger.rules.limits import Limits


class Given:
    """Offers as they are given to one maker, and what it answers."""

    def __init__(self, *offers: Offer, tries: int = 1) -> None:
        self._offers = [
            Waiting(
                offer.transaction.robot,
                pack_offer(offer),
                SimpleNamespace(
                    reply=(offer.transaction.id, number),
                    metadata=SimpleNamespace(num_delivered=tries),
                ),
            )
            for number, offer in enumerate(offers)
        ]
        self.answers: list[tuple[str, bytes]] = []
        self.delays_s: list[float] = []

    def take(self, most: int, wait_s: float) -> list[Waiting]:
        taken, self._offers = self._offers[:most], self._offers[most:]
        return taken

    def _note(self, what: str, offers: Sequence[Waiting]) -> None:
        self.answers += [(what, offer.message.reply[0]) for offer in offers]

    def done(self, *offers: Waiting) -> None:
        self._note("done", offers)

    def refuse(self, why: str, *offers: Waiting) -> None:
        self._note("refused", offers)

    def later(self, delay_s: float, *offers: Waiting) -> None:
        self._note("later", offers)
        self.delays_s += [delay_s] * len(offers)


def following(ledger: Ledger, count: int) -> list[Offer]:
    """A robot's next ones, each after the one before."""
    offers: list[Offer] = []
    for number in range(count):
        draft = ledger.draft_transaction("R1", b"%d" % number, "view", 60 + number)
        if offers:
            last = offers[-1].transaction
            draft = replace(draft, sequence=last.sequence + 1, previous=last.id)
        offers.append(Offer(draft.signed(KEYS["R1"]), b"%d" % number))
    return offers


@pytest.fixture
def log(tmp_path: Path) -> FolderLog:
    small_ledger(tmp_path / "log")
    return FolderLog(tmp_path / "log")


def test_what_another_maker_has_made_a_block_of_meanwhile_is_not_refused(
    log: FolderLog, tmp_path: Path
) -> None:
    with (
        Replicated.join(tmp_path / "one", log) as one,
        Replicated.join(tmp_path / "two", FolderLog(tmp_path / "log")) as two,
    ):
        for ledger in (one, two):
            ledger.catch_up()
        (offer,) = following(one, 1)
        first = Maker(one, Given(offer), "R2", KEYS["R2"], clock=lambda: 100)

        def overtaken() -> int:  # asked for as it is judged: the other one is quicker
            first.turn(0.0)
            return 100

        given = Given(offer)
        assert Maker(two, given, "R3", KEYS["R3"], clock=overtaken).turn(0.0) == 0
        assert two.latest("R1") == offer.transaction
        assert given.answers == [("done", offer.transaction.id)]


def test_what_comes_before_its_turn_is_given_back_and_what_is_in_is_done(
    log: FolderLog, tmp_path: Path
) -> None:
    with Replicated.join(tmp_path / "one", log) as ledger:
        ledger.catch_up()
        a, b, c = following(ledger, 3)
        given = Given(c, a, b, a)
        assert Maker(ledger, given, "R2", KEYS["R2"], clock=lambda: 100).turn(0.0) == 2
        ids = [offer.transaction.id for offer in (a, c, a, b)]  # the second a is one too many
        assert given.answers == [*zip(["done", "later", "done", "done"], ids, strict=True)]


def test_what_is_never_followed_up_is_asked_for_less_and_less_and_let_go(
    log: FolderLog, tmp_path: Path
) -> None:
    """A member that leaves one out had its offers handed out ten times a second."""
    with Replicated.join(tmp_path / "one", log) as ledger:
        ledger.catch_up()
        _, alone = following(ledger, 2)
        delays_s, answers = [], []
        for tries in range(1, 22):
            given = Given(alone, tries=tries)
            assert Maker(ledger, given, "R2", KEYS["R2"], clock=lambda: 100).turn(0.0) == 0
            delays_s += given.delays_s
            answers += [what for what, _ in given.answers]
        assert answers == ["later"] * 20 + ["done"]
        assert delays_s[:4] == [0.1, 0.2, 0.4, 0.8] and max(delays_s) == 5.0
        assert sum(delays_s) > 60.0  # as long as another maker may take to start


def test_what_is_over_its_rate_is_asked_for_less_and_less(log: FolderLog, tmp_path: Path) -> None:
    """Its message, half a megabyte, was sent again twice a second."""
    with Replicated.join(tmp_path / "one", log) as ledger:
        ledger.catch_up()
        first, over = following(ledger, 2)
        given, limits = Given(first), Limits(rate_per_s=1e-6, burst=1)
        maker = Maker(ledger, given, "R2", KEYS["R2"], clock=lambda: 100, limits=limits)
        assert maker.turn(0.0) == 1
        delays_s = []
        for tries in (1, 2, 3, 4, 5, 600):
            maker._offers = given = Given(over, tries=tries)
            assert maker.turn(0.0) == 0 and given.answers == [("later", over.transaction.id)]
            delays_s += given.delays_s
        assert delays_s == [0.5, 1.0, 2.0, 4.0, 5.0, 5.0]


def test_of_two_makers_one_is_given_all_and_the_other_takes_over(tmp_path: Path) -> None:
    """Two that were given every second offer of a robot would each wait for the other's."""
    skip_without_servers()
    small_ledger(tmp_path / "ledger")
    cluster = Cluster.make(tmp_path / "servers", 1)
    with cluster.running():
        stream = Stream(Connection(Servers.at(cluster.address)))
        with Ledger.open(tmp_path / "ledger") as ledger:
            put(ledger, stream, -1)
        stream.close()
        with (
            open_ledger(cluster.address, tmp_path / "R1") as r1,
            making(cluster.address, tmp_path / "two", "R2") as two,
        ):
            assert isinstance(r1, RobotLedger)
            with making(cluster.address, tmp_path / "one", "R3") as one:
                for number in range(30):
                    r1.publish("R1", KEYS["R1"], b"%d" % number, "view", 60 + number)
                r1.wait(timeout_s=PATIENCE_S)
                for maker in (one, two):
                    assert maker.counts["SequenceGapError"] == 0, (one.counts, two.counts)
            for number in range(30, 40):  # by the other one, if it was this one that has gone
                r1.publish("R1", KEYS["R1"], b"%d" % number, "view", 60 + number)
            r1.wait(timeout_s=PATIENCE_S)
            assert len(r1.history("R1")) == 42
