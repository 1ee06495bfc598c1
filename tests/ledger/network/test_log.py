"""A log, in a folder and on servers: one suite for both."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from clusters import PATIENCE_S
from ledgers import KEYS, OPERATOR_KEY, files, long_ledger

from vrchain.ledger import Drop, Ledger, Offer, verify
from vrchain.ledger.errors import (
    ClusterError,
    DuplicateMemberError,
    ForkError,
    GapError,
    LedgerBusyError,
    NotALedgerError,
    OvertakenError,
    PayloadDigestError,
    WrongLedgerError,
)
from vrchain.ledger.network.connection import Connection, Servers
from vrchain.ledger.network.log import FolderLog, Log, put
from vrchain.ledger.network.replicated import EVIDENCE_NAME, Replicated
from vrchain.ledger.network.stream import Stream
from vrchain.ledger.records.encoding import digest
from vrchain.ledger.storage.place import OUTBOX_NAME

MakeLog = Callable[[], Log]


@pytest.fixture(params=["folder", "servers"])
def make_log(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[MakeLog]:
    """Makes handles on one new log, as several machines have."""
    with contextlib.ExitStack() as stack:

        def make() -> Log:
            if request.param == "folder":
                log: Log = FolderLog(tmp_path / "log")
            else:
                cluster = request.getfixturevalue("servers")
                log = Stream(Connection(Servers.at(cluster.address)))
            stack.callback(log.close)
            return log

        yield make


@pytest.fixture
def log(make_log: MakeLog, folder: Path) -> Log:
    """A log that holds ``small_ledger``."""
    made = make_log()
    with Ledger.open(folder) as ledger:
        put(ledger, made, -1)
    return made


def test_what_was_put_comes_out_in_order_with_every_blob(log: Log, folder: Path) -> None:
    given = list(log.follow(-1))
    with Ledger.open(folder) as ledger:
        assert [entry for entry, _ in given] == list(ledger.entries())
        for entry, blobs in given:
            named = {b for r in entry.records for b in getattr(r, "blobs", ())}
            assert blobs == {blob: ledger.payload(blob) for blob in named}
    assert list(log.follow(2)) == given[3:]
    assert list(log.follow(5)) == []


def test_a_log_that_lost_its_first_block_is_followed_by_who_has_it(
    log: Log, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Replicated.join(tmp_path / "own", log):
        pass
    follow = log.follow

    def lacks_one(after: int, wait_s: float = 0.0) -> Iterator[object]:
        if after < 0:
            raise GapError("a server lacks block 0")
        yield from follow(after, wait_s)

    monkeypatch.setattr(log, "follow", lacks_one)
    with Replicated.join(tmp_path / "own", log) as own:
        assert own.catch_up() == 5


def test_a_folder_is_begun_and_comes_to_the_same_head(
    log: Log, folder: Path, tmp_path: Path
) -> None:
    with Replicated.join(tmp_path / "own", log) as own:
        assert own.head.height == 0
        assert own.catch_up() == 5
        assert own.catch_up() == 0
    found = verify(tmp_path / "own")
    assert (found.ok, found.blocks) == (True, 6)
    blobs = [
        {n: b for n, b in files(f).items() if n.startswith("blobs")} for f in (folder, own.folder)
    ]
    assert blobs[0] == blobs[1] and len(blobs[0]) == 4


def test_of_two_that_append_one_is_overtaken_and_makes_its_block_anew(
    log: Log, make_log: MakeLog, tmp_path: Path
) -> None:
    with (
        Replicated.join(tmp_path / "a", log) as a,
        Replicated.join(tmp_path / "b", make_log()) as b,
    ):
        a.catch_up(), b.catch_up()
        offers = [
            Offer(own.draft_transaction(r, r.encode(), "view", 60).signed(KEYS[r]), r.encode())
            for own, r in ((a, "R1"), (b, "R2"))
        ]
        entry, _ = b.make([offers[1].transaction], "R2", KEYS["R2"])
        a.append_many(offers[:1], "R1", KEYS["R1"])
        with pytest.raises(OvertakenError):
            b.log.append(entry, offers[1].blobs, after=b.head.height)
        block = b.append_many(offers[1:], "R2", KEYS["R2"])
        assert (block.height, block.previous_hash) == (7, a.head.hash)
        assert a.catch_up() == 1 and a.head == b.head


def test_several_writers_lose_nothing_and_agree(
    log: Log, make_log: MakeLog, tmp_path: Path
) -> None:
    robots, each = ("R1", "R2", "R3"), 5

    def write(robot: str) -> None:
        with (
            contextlib.closing(make_log()) as other,
            Replicated.join(tmp_path / robot, other) as own,
        ):
            own.catch_up()
            for number in range(each):
                payload = f"{robot} {number}".encode()
                draft = own.draft_transaction(robot, payload, "view", 60 + number)
                own.append_many([Offer(draft.signed(KEYS[robot]), payload)], robot, KEYS[robot])

    threads = [threading.Thread(target=write, args=(robot,)) for robot in robots]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    heads = set()
    for robot in robots:
        with Replicated.join(tmp_path / robot, log) as own:
            own.catch_up()
            heads.add(own.head.hash)
            assert [len(own.history(r)) for r in robots] == [2 + each, 1 + each, 1 + each]
        assert verify(tmp_path / robot).ok
    assert len(heads) == 1


def test_the_operator_enrols_expels_and_drops_through_the_log(
    log: Log, make_log: MakeLog, tmp_path: Path
) -> None:
    with (
        Replicated.join(tmp_path / "a", log) as a,
        Replicated.join(tmp_path / "b", make_log()) as b,
    ):
        a.enrol("R4", KEYS["R3"].public, OPERATOR_KEY, 60)
        a.expel("R3", OPERATOR_KEY, 70)
        assert len(a.drop_old(1, OPERATOR_KEY, 80)) == 1
        with pytest.raises(DuplicateMemberError):
            b.enrol("R4", KEYS["R3"].public, OPERATOR_KEY, 60)
        assert b.head == a.head and b.robots == ("R1", "R2", "R4")
    names = [{p.name for p in (tmp_path / f / "blobs").iterdir()} for f in "ab"]
    assert names[0] == names[1] and len(names[0]) == 3  # what was dropped is gone in both


def test_what_was_dropped_is_excused_by_the_operators_record_alone(
    make_log: MakeLog, tmp_path: Path
) -> None:
    log = make_log()
    long_ledger(tmp_path / "long")
    with Ledger.open(tmp_path / "long") as ledger:
        put(ledger, log, -1)
    with Replicated.join(tmp_path / "own", log) as own:
        assert own.catch_up() == 11
    found = verify(tmp_path / "own")
    assert found.ok and found.dropped
    entry, blobs = next(iter(log.follow(0)))
    forged = Drop(own.genesis.id, 0, 0, tuple(entry.records[0].blobs))  # type: ignore[union-attr]
    for excuse in (b"", forged.signed(KEYS["R1"]).record):
        with (
            Replicated.join(tmp_path / f"other {len(excuse)}", log) as other,
            pytest.raises(PayloadDigestError),
        ):
            other.take(entry, {digest(excuse): excuse})
    with Replicated.join(tmp_path / "other", log) as other:
        assert other.take(entry, blobs)


def test_a_drop_from_before_a_blob_was_named_again_excuses_nothing(
    make_log: MakeLog, folder: Path, tmp_path: Path
) -> None:
    log = make_log()
    with Ledger.open(folder, writable=True) as ledger:
        ledger.drop_old(1, OPERATOR_KEY, 60)
        ledger.publish("R1", KEYS["R1"], b"first of R1", "time", 70)
        put(ledger, log, -1)
    *before, (entry, blobs) = log.follow(0)
    (drop,) = before[-1][0].records
    with Replicated.join(tmp_path / "own", log) as own:
        for given in before:
            own.take(*given)
        with pytest.raises(PayloadDigestError):
            own.take(entry, {digest(drop.record): drop.record})
        assert own.take(entry, blobs)
    assert verify(tmp_path / "own").ok


def test_a_block_beside_the_chain_convicts_who_was_expelled_too_and_fills_no_disk(
    log: Log, tmp_path: Path
) -> None:
    with Replicated.join(tmp_path / "own", log) as own:
        own.catch_up()
        mine = next(own.entry(h).block for h in range(1, 6) if own.entry(h).block.author == "R1")
        own.expel("R1", OPERATOR_KEY, 60)
        for later_ns in range(1, 5):
            second = replace(mine, timestamp_ns=mine.timestamp_ns + later_ns).signed(KEYS["R1"])
            with pytest.raises(ForkError, match="R1 signed a second block"):
                own.convict(second)
        assert len(list((own.folder / EVIDENCE_NAME).iterdir())) == 2
        assert len(own.alarms) == 1 and "R1 has signed a block beside this chain" in own.alarms[0]


def test_what_comes_later_is_waited_for(log: Log, make_log: MakeLog, tmp_path: Path) -> None:
    came = threading.Event()
    given = []

    def follow() -> None:
        with contextlib.closing(make_log()) as other:
            given.append(next(other.follow(5, wait_s=PATIENCE_S)))
        came.set()

    thread = threading.Thread(target=follow)
    thread.start()
    with Replicated.join(tmp_path / "own", log) as own:
        own.catch_up()
        own.enrol("R4", KEYS["R3"].public, OPERATOR_KEY, 60)
        assert came.wait(PATIENCE_S)
        assert given[0][0] == own.entry(6)
    thread.join()


def test_a_folder_that_has_parted_from_the_log_appends_nothing_to_it(
    log: Log, tmp_path: Path
) -> None:
    with Replicated.join(tmp_path / "own", log) as own:
        own.catch_up()
        height = own.head.height
    with Ledger.open(tmp_path / "own", writable=True) as alone:
        with pytest.raises(ClusterError, match="follows servers; what is written there alone"):
            alone.enrol("R8", KEYS["R3"].public, OPERATOR_KEY, 60)
        (tmp_path / "own" / OUTBOX_NAME).rmdir()
        alone.enrol("R8", KEYS["R3"].public, OPERATOR_KEY, 60)
    with Replicated.join(tmp_path / "another", log) as another:
        another.enrol("R9", KEYS["R3"].public, OPERATOR_KEY, 60)
    with Replicated.join(tmp_path / "own", log) as own:
        for work in (own.catch_up, lambda: own.enrol("R7", KEYS["R3"].public, OPERATOR_KEY, 70)):
            with pytest.raises(WrongLedgerError, match=f"parted .* {height + 1}, by operator"):
                work()
        with pytest.raises(WrongLedgerError, match="parted"):
            put(own, log, height + 1)
    with Replicated.join(tmp_path / "another", log) as another:
        assert another.catch_up() == 0 and another.head.height == height + 1


def test_a_log_of_another_ledger_is_refused_and_the_folder_stays(log: Log, tmp_path: Path) -> None:
    with Ledger.create(tmp_path / "own", {}, OPERATOR_KEY, name="another"):
        pass
    before = files(tmp_path / "own")
    with (
        Replicated.join(tmp_path / "own", log) as own,
        pytest.raises(WrongLedgerError, match=r"hold another ledger, [0-9a-f]{64}, than .*choose"),
    ):
        own.catch_up()
    assert files(tmp_path / "own") == before


def test_a_block_that_does_not_follow_is_taken_in_nowhere(
    log: Log, make_log: MakeLog, tmp_path: Path
) -> None:
    """A dishonest maker puts a well-signed block without its blob into the log."""
    if isinstance(log, FolderLog):
        return  # a folder judges what it is given
    with Replicated.join(tmp_path / "own", log) as own:
        own.catch_up()
        draft = own.draft_transaction("R1", b"payload", "view", 60).signed(KEYS["R1"])
        entry, _ = own.make([draft], "R2", KEYS["R2"])
        log.append(entry, {draft.payload_digest: b"another"}, after=5)
        with pytest.raises(GapError, match=r"blobs are not those .*127\.0\.0\.1:\d+: block 6"):
            own.catch_up()
        assert own.head.height == 5
    assert verify(tmp_path / "own").ok


def test_an_empty_log_begins_no_folder(make_log: MakeLog, tmp_path: Path) -> None:
    with pytest.raises(NotALedgerError):
        Replicated.join(tmp_path / "own", make_log())
    assert not (tmp_path / "own").exists()


def test_a_follower_cleans_while_nobody_else_writes(log: Log, tmp_path: Path) -> None:
    """Or the blobs of a block that comes meanwhile would be taken for nobody's."""
    with (
        Replicated.join(tmp_path / "own", log) as own,
        Ledger.open(tmp_path / "own", writable=True) as other,
    ):
        own.catch_up()
        own._wait_s = 0.1
        with other._turn(), pytest.raises(LedgerBusyError):
            own.clean()
        assert own.clean() == 0
