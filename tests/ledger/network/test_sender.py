"""What waits in an outbox goes out in order; what never comes into the chain holds up nothing."""

import logging
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from clusters import PATIENCE_S, eventually, making
from ledgers import KEYS, OPERATOR_KEY
from typer.testing import CliRunner

from vrchain.cli import app
from vrchain.ledger import Ledger, Offer, Transaction, errors, verify
from vrchain.ledger.cluster.servers import Cluster
from vrchain.ledger.network import sender as sender_module
from vrchain.ledger.network.message import pack_refusal
from vrchain.ledger.network.opening import open_ledger
from vrchain.ledger.network.outbox import Outbox, offer_in, refused_in
from vrchain.ledger.network.robot import RobotLedger
from vrchain.ledger.network.sender import Sender
from vrchain.ledger.rules.limits import UNLIMITED


class Office:
    """Takes offers as servers do; ``told`` is what it has to say of them."""

    def __init__(self) -> None:
        self.offers: list[Offer] = []
        self.told: list[bytes] = []
        self.held = 0  # of what was sent, that waits for a maker

    def offer(self, robot: str, offer_id: bytes, data: bytes) -> None:
        self.offers.append(offer_in(data))
        assert self.offers[-1].transaction.id == offer_id

    def refusals(self) -> list[bytes]:
        told, self.told = self.told, []
        return told

    def offers_of(self, robot: str) -> int:
        return self.held

    def say(self, head: bytes) -> None:
        raise AssertionError

    def heads(self) -> list[tuple[str, bytes]]:
        raise AssertionError


@pytest.fixture
def outbox(tmp_path: Path) -> Iterator[Outbox]:
    (tmp_path / "robot").mkdir()
    with Outbox(tmp_path / "robot") as made:
        yield made


@pytest.fixture
def ledger(folder: Path) -> Iterator[Ledger]:
    with Ledger.open(folder, writable=True) as opened:
        yield opened


@pytest.fixture
def office() -> Office:
    return Office()


@pytest.fixture
def sender(outbox: Outbox, office: Office) -> Sender:
    return Sender(outbox, office, threading.Event())


def fill(outbox: Outbox, ledger: Ledger, count: int = 4) -> list[Transaction]:
    """R1's next transactions, with the payloads 0, 1, ..."""
    draft, signed = ledger.draft_transaction("R1", b"0", "view", 60), list[Transaction]()
    for number in range(count):
        payload = b"%d" % number
        named = ledger.draft_transaction("R1", payload, "view", 60 + number)
        if signed:
            named = replace(named, sequence=draft.sequence + number, previous=signed[-1].id)
        signed.append(named.signed(KEYS["R1"]))
        outbox.put(Offer(signed[-1], payload))
    return signed


def refuse(office: Office, transaction: Transaction, why: str = "too large") -> None:
    office.told.append(pack_refusal(transaction.id.hex(), why))


def test_what_follows_a_refused_one_is_signed_anew_and_valid(
    sender: Sender, outbox: Outbox, office: Office, ledger: Ledger
) -> None:
    sender.keys["R1"] = KEYS["R1"]
    signed = fill(outbox, ledger)
    sender.hand_on(ledger)
    assert [offer.transaction for offer in office.offers] == signed
    office.offers.clear()
    refuse(office, signed[1])
    sender.hand_on(ledger)
    assert refused_in(outbox.folder.parent) == [("R1", 3, "too large")]
    assert [offer.payload for offer in office.offers] == [b"2", b"3"]
    anew = [offer.transaction for offer in office.offers]
    assert [t.sequence for t in anew] == [3, 4] and anew[0].previous == signed[0].id
    assert [sender.goes_out_as(t) for t in (signed[0], *signed[2:])] == [signed[0], *anew]
    for ask in (sender.check_refused, lambda: sender.goes_out_as(signed[1])):
        with pytest.raises(errors.RefusedError, match="transaction 3 of R1 was refused: too large"):
            ask()
    sender.check_refused()  # it was told
    ledger.append_many([Offer(signed[0], b"0"), *office.offers], "R2", KEYS["R2"])
    sender.hand_on(ledger)
    assert outbox.count() == 0 and len(office.offers) == 2


def test_what_waits_with_the_servers_is_not_sent_again(
    sender: Sender, outbox: Outbox, office: Office, ledger: Ledger, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a maker; servers forget after two minutes that they know an offer."""
    monkeypatch.setattr(sender_module, "_AGAIN_S", 0.0)
    fill(outbox, ledger)
    for held in (4, 4, 2):
        sender.hand_on(ledger)
        office.held = held
    assert len(office.offers) == 4
    sender.hand_on(ledger)  # two of them were lost, or are in a block that has not come yet
    assert [offer.payload for offer in office.offers[4:]] == [b"2", b"3"]


def test_what_was_set_aside_is_told_though_nobody_knows_why(
    sender: Sender, outbox: Outbox, office: Office, ledger: Ledger
) -> None:
    signed = fill(outbox, ledger, 1)
    sender.hand_on(ledger)
    refuse(office, signed[0])
    sender.hand_on(ledger)
    (why,) = (outbox.folder / "refused").glob("*.why")
    why.unlink()
    assert refused_in(outbox.folder.parent) == [("R1", 2, "")]


def test_a_copy_in_its_place_is_known(outbox: Outbox, tmp_path: Path) -> None:
    """With the numbers of the files that were there, as it happens on ext4."""
    outbox.folder.with_name("ledger.sqlite").touch()
    outbox.settle()
    assert not outbox.is_moved
    told = outbox._place().split()
    (outbox.folder / "lock").unlink()
    outbox.close()
    with Outbox(outbox.folder.parent) as again:
        assert again._place().split()[:4] == told[:4] and again.is_moved


def test_without_the_key_what_follows_is_set_aside_too_and_told(
    sender: Sender,
    outbox: Outbox,
    office: Office,
    ledger: Ledger,
    caplog: pytest.LogCaptureFixture,
) -> None:
    signed = fill(outbox, ledger)
    sender.hand_on(ledger)
    refuse(office, signed[2])
    with caplog.at_level(logging.WARNING):
        sender.hand_on(ledger)
    assert [each[:2] for each in refused_in(outbox.folder.parent)] == [("R1", 4), ("R1", 5)]
    assert "key is not here" in refused_in(outbox.folder.parent)[1][2]
    assert caplog.messages[0] == "transaction 4 of R1 was refused for good: too large"
    assert len(caplog.messages) == 2 and outbox.count() == 2


@pytest.mark.parametrize("why", ["expelled", "another", "damaged"])
def test_what_cannot_come_into_the_chain_is_set_aside_by_the_robot_itself(
    why: str, sender: Sender, outbox: Outbox, office: Office, ledger: Ledger
) -> None:
    (transaction,) = fill(outbox, ledger, 1)
    (path,) = [path for _, _, path in outbox.waiting()]
    data = path.read_bytes()
    if why == "expelled":
        ledger.expel("R1", OPERATOR_KEY, 60)
    elif why == "another":
        ledger.publish("R1", KEYS["R1"], b"from elsewhere", "view", 60)
    else:
        path.write_bytes(data[:-1])
    sender.hand_on(ledger)
    ((robot, sequence, told),) = refused_in(outbox.folder.parent)
    assert (robot, sequence) == ("R1", transaction.sequence) and told
    assert office.offers == [] and outbox.count() == 0
    kept = next((outbox.folder / "refused").glob("*.offer"))
    assert kept.read_bytes() == (data[:-1] if why == "damaged" else data)


def test_garbage_that_a_maker_says_refuses_nothing(
    sender: Sender, outbox: Outbox, office: Office, ledger: Ledger
) -> None:
    fill(outbox, ledger)
    sender.hand_on(ledger)
    office.told += [b"garbage", pack_refusal("", "nothing"), pack_refusal("00" * 32, "nobody's")]
    sender.hand_on(ledger)
    assert outbox.count() == len(office.offers) == 4


def test_a_robot_is_told_what_a_maker_refuses_and_the_rest_goes_out(
    servers: Cluster, address: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    limits = replace(UNLIMITED, blob_bytes=1000)
    with (
        making(address, tmp_path / "maker", limits=limits),
        open_ledger(address, tmp_path / "R1", name="R1") as r1,
        open_ledger(address, tmp_path / "R3", name="R3") as r3,
    ):
        assert isinstance(r1, RobotLedger) and isinstance(r3, RobotLedger)
        r1.wait_until_followed(PATIENCE_S)
        payloads = [b"0", bytes(2000), b"2", b"3"]
        sent = [r1.publish("R1", KEYS["R1"], p, "view", 60 + k) for k, p in enumerate(payloads)]
        r1.wait(sent[0], PATIENCE_S)
        with pytest.raises(errors.RefusedError, match=r"of at most 1000, got .* 2000"):
            r1.wait(sent[1], PATIENCE_S)
        r1.wait(sent[3], PATIENCE_S)
        r1.wait(timeout_s=PATIENCE_S)
        r3.publish("R3", KEYS["R3"], bytes(2000), "view", 60)
        with pytest.raises(errors.RefusedError, match=r"of at most 1000, got .* 2000"):
            r3.wait(timeout_s=PATIENCE_S)
        assert [r1.payload(t.payload_digest) for t in r1.history("R1")[2:]] == [b"0", b"2", b"3"]
        eventually(lambda: r3.others.get("R1") == (r1.head.height, (0, 1, 0)), "others hear of it")
    assert [m for m in caplog.messages if "transaction 3 of R1 was refused for good" in m]
    done = CliRunner().invoke(app, ["ledger", "watch", str(tmp_path / "R1"), "--seconds", "0"])
    assert "transaction 3 of R1 was refused: expected a record" in done.output
    assert verify(tmp_path / "R1").ok
