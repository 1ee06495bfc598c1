"""The ledger on disk: durable, shared by processes, and refusing without a trace."""

import os
import sqlite3
import stat
from contextlib import closing
from pathlib import Path
from unittest.mock import Mock, patch

import pytest
from ledgers import KEYS, OPERATOR_KEY, PUBLIC, files, long_ledger, new_ledger, said_by

from vrchain.ledger import NO_BLOB, Ledger, Offer, PublicKey, errors, random_key, verify
from vrchain.ledger.records.encoding import MAX_PAYLOAD_BYTES, digest
from vrchain.ledger.records.keys import DATABASE_NAME


def test_what_was_published_is_read_back_by_a_fresh_handle(folder: Path) -> None:
    with Ledger.open(folder) as ledger:
        assert ledger.head.height == 5
        assert ledger.robots == ("R1", "R2", "R3")
        assert ledger.genesis.insecure
        newest = ledger.latest("R1")
        assert newest is not None
        assert (newest.sequence, newest.timestamp_ns, newest.reason) == (1, 50, "distance")
        assert ledger.payload(newest.payload_digest) == b"second of R1"
        assert ledger.transaction(newest.id) == newest
        assert [t.sequence for t in ledger.history("R1")] == [0, 1]
        assert ledger.history("R1")[-1] == newest
        blocks = [entry.block for entry in ledger.entries()]
        assert [block.height for block in blocks] == list(range(6))
        assert [entry.block.height for entry in ledger.entries(from_height=4)] == [4, 5]
        assert [b.previous_hash for b in blocks[1:]] == [b.hash for b in blocks[:-1]]
        assert dict(blocks[-1].newest) == {
            robot: t.id for robot in ledger.robots if (t := ledger.latest(robot))
        }


def test_a_payload_is_its_sha256_on_disk(ledger: Ledger) -> None:
    for time_ns in (1, 2):
        ledger.publish("R1", KEYS["R1"], b"bytes", "time", time_ns)
    blobs = [f for f in files(ledger.folder) if f.startswith("blobs")]
    assert blobs == [f"blobs/{digest(b'bytes').hex()}"]


def test_the_payload_is_durable_before_the_record_that_names_it(
    ledger: Ledger, monkeypatch: pytest.MonkeyPatch
) -> None:
    fsync, replace = os.fsync, os.replace
    steps: list[str] = []

    def logged_fsync(handle: int) -> None:
        steps.append("sync folder" if stat.S_ISDIR(os.fstat(handle).st_mode) else "sync file")
        fsync(handle)

    def logged_replace(source: str, target: str) -> None:
        steps.append("rename")
        replace(source, target)

    assert ledger._db.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    assert ledger._db.execute("PRAGMA synchronous").fetchone() == (2,)  # FULL
    ledger._db.set_trace_callback(lambda sql: steps.append(sql.split()[0]))
    monkeypatch.setattr("os.fsync", logged_fsync)
    monkeypatch.setattr("os.replace", logged_replace)
    ledger.publish("R1", KEYS["R1"], b"payload", "start", 1)
    made = ["sync folder"]  # for blobs/, new here
    written = ["sync file", "rename", "sync folder"]
    steps = [step for step in steps if step != "SELECT"]
    assert steps == ["BEGIN", *made, *written, "INSERT", "INSERT", "COMMIT"]


def test_what_is_not_there(ledger: Ledger) -> None:
    assert ledger.latest("R1") is None
    assert ledger.history("R1") == []
    for read in (ledger.transaction, ledger.payload):
        with pytest.raises(errors.NotFoundError):
            read(bytes(32))
    with pytest.raises(errors.NotFoundError, match="no transaction but the genesis"):
        ledger.transaction(ledger.genesis.id)
    with pytest.raises(errors.NotFoundError):
        ledger.entry(1)
    for robot in ("R9", ""):
        with pytest.raises(errors.UnknownMemberError):
            ledger.latest(robot)


def test_a_changed_payload_is_noticed_on_reading(ledger: Ledger) -> None:
    transaction = ledger.publish("R1", KEYS["R1"], b"bytes", "time", 1)
    path = next(p for p in (ledger.folder / "blobs").rglob("*") if p.is_file())
    path.write_bytes(b"Bytes")
    with pytest.raises(errors.DamagedError):
        ledger.payload(transaction.payload_digest)
    ledger.publish("R1", KEYS["R1"], b"bytes", "time", 2)  # publishing it anew mends it
    assert ledger.payload(transaction.payload_digest) == b"bytes"


def test_what_is_refused_leaves_no_trace(folder: Path) -> None:
    before = files(folder)
    with Ledger.open(folder, writable=True) as ledger:
        for kind, changes in (
            (errors.UnknownMemberError, {"robot": "R9"}),
            (errors.SignatureError, {"key": KEYS["R2"]}),
            (errors.RecordError, {"reason": "because"}),
            (errors.TimeOrderError, {"timestamp_ns": 49}),
            (errors.RecordError, {"timestamp_ns": -1}),
            (errors.RecordError, {"payload": "x"}),
            (errors.TooLargeError, {"payload": bytes(MAX_PAYLOAD_BYTES + 1)}),
        ):
            good = {"robot": "R1", "key": KEYS["R1"], "payload": b"x", "reason": "time"}
            with pytest.raises(kind):
                ledger.publish(**{**good, "timestamp_ns": 60, **changes})
        assert ledger.head.height == 5
    assert files(folder) == before


@pytest.mark.parametrize("step", ["storage.blobs.sync_folder", "store.insert_entry"])
def test_ctrl_c_before_the_record_leaves_no_trace(folder: Path, step: str) -> None:
    before = files(folder)
    with Ledger.open(folder, writable=True) as ledger:
        remove = ledger._blobs.remove

        def removed(blob: bytes) -> None:
            assert ledger._db.in_transaction  # or another writer may need it by now
            remove(blob)

        with (
            patch(f"vrchain.ledger.{step}", side_effect=KeyboardInterrupt),
            patch.object(ledger._blobs, "remove", removed),
            pytest.raises(KeyboardInterrupt),
        ):
            ledger.publish("R1", KEYS["R1"], b"x", "time", 60)
        assert files(folder) == before
        assert ledger.publish("R1", KEYS["R1"], b"x", "time", 60).sequence == 2


def test_several_transactions_come_in_one_block_or_none(ledger: Ledger) -> None:
    """R1 and R2 sign, R1 makes the block; blobs that are not theirs are no offer."""
    drafts = [ledger.draft_transaction(robot, b"x", "start", 1) for robot in ("R1", "R2")]
    offers = [Offer(draft.signed(KEYS[draft.robot]), b"x") for draft in drafts]
    forged = Offer(drafts[1].signed(KEYS["R1"]), b"x")
    before = files(ledger.folder)
    with pytest.raises(errors.SignatureError):
        ledger.append_many([offers[0], forged], "R1", KEYS["R1"])
    assert files(ledger.folder) == before
    assert ledger.latest("R1") is None
    block = ledger.append_many(offers, "R1", KEYS["R1"])
    assert (block.height, block.author) == (1, "R1")
    assert ledger.entry(1).records == tuple(offer.transaction for offer in offers)
    assert block.newest == tuple((o.transaction.robot, o.transaction.id) for o in offers)
    for bad, kind in (([], errors.RecordListError), (offers, errors.ReplayError)):
        with pytest.raises(kind):
            ledger.append_many(bad, "R1", KEYS["R1"])
    for other in ({"payload": b"y"}, {"landmarks": b"x"}):
        with pytest.raises(errors.PayloadDigestError):
            Offer(**{"transaction": drafts[0], "payload": b"x", **other})
    assert verify(ledger.folder).ok


def test_the_landmark_record_is_a_blob_of_its_own(ledger: Ledger) -> None:
    with_landmarks = ledger.publish("R1", KEYS["R1"], b"p", "start", 1, landmarks=b"seen")
    without = ledger.publish("R1", KEYS["R1"], b"p", "time", 2)
    assert ledger.payload(with_landmarks.landmarks_digest) == b"seen"
    assert with_landmarks.blobs == (digest(b"p"), digest(b"seen"))
    assert (without.landmarks_digest, without.blobs) == (NO_BLOB, (digest(b"p"),))
    assert (with_landmarks.previous, without.previous) == (bytes(32), with_landmarks.id)


def test_an_older_number_signed_twice_is_equivocation(ledger: Ledger) -> None:
    second_tale = ledger.draft_transaction("R1", b"other", "start", 1).signed(KEYS["R1"])
    first = ledger.publish("R1", KEYS["R1"], b"one", "start", 1)
    ledger.publish("R1", KEYS["R1"], b"two", "time", 2)
    with pytest.raises(errors.EquivocationError, match="two transactions") as raised:
        ledger.append_many([Offer(second_tale, b"other")], "R2", KEYS["R2"])
    assert (raised.value.first, raised.value.second) == (first, second_tale)
    for evidence in (first, second_tale):
        assert KEYS["R1"].public.accepts(evidence.body, evidence.signature)
    with pytest.raises(errors.ReplayError):
        ledger.append_many([Offer(first, b"one")], "R2", KEYS["R2"])


def test_an_update_verifies_one_signature(ledger: Ledger) -> None:
    with patch.object(PublicKey, "accepts", autospec=True, side_effect=PublicKey.accepts) as asked:
        transaction = ledger.publish("R1", KEYS["R1"], b"x", "start", 1)
    assert [call.args[1] for call in asked.call_args_list] == [transaction.body]
    draft = ledger.draft_transaction("R2", b"x", "start", 1).signed(KEYS["R2"])
    with pytest.raises(errors.SignatureError, match="key of R1"):  # the author's is another's
        ledger.append_many([Offer(draft, b"x")], "R1", KEYS["R2"])


def test_following_what_others_append(folder: Path) -> None:
    with Ledger.open(folder) as reader, Ledger.open(folder, writable=True) as writer:
        seen: list[int] = []
        for entry in reader.follow(3, wait_s=0.05):
            seen.append(entry.block.height)
            if len(seen) == 3:
                writer.publish("R1", KEYS["R1"], b"six", "time", 60)
                writer.publish("R2", KEYS["R2"], b"seven", "time", 70)
        assert seen == [3, 4, 5, 6, 7]
        assert reader.head == writer.head
        assert list(reader.follow(8, wait_s=0)) == []


def test_every_block_has_its_own_table_wherever_one_starts_to_read(tmp_path: Path) -> None:
    long_ledger(tmp_path / "ledger")
    with Ledger.open(tmp_path / "ledger") as ledger:
        tables = [entry.block.newest for entry in ledger.entries()]
        assert tables[0] == (("R1", bytes(32)), ("R2", bytes(32)))
        assert [robot for robot, _ in tables[3]] == ["R1", "R2", "R3"]
        assert [robot for robot, _ in tables[-1]] == ["R1", "R2"]
        for height in range(len(tables)):
            assert [e.block.newest for e in ledger.entries(height)] == tables[height:]
            assert ledger.entry(height).block.newest == tables[height]
        assert ledger.head.newest == tables[-1]


def test_only_the_operator_enrols_and_expels(ledger: Ledger) -> None:
    for change in (ledger.enrol, lambda name, key, *rest: ledger.expel("R2", *rest)):
        with pytest.raises(errors.SignatureError):
            change("R3", KEYS["R3"].public, KEYS["R1"], 1)
    ledger.enrol("R3", KEYS["R3"].public, OPERATOR_KEY, 1)
    ledger.publish("R3", KEYS["R3"], b"x", "start", 2)
    with pytest.raises(errors.DuplicateMemberError):
        ledger.enrol("R3", random_key().public, OPERATOR_KEY, 3)
    with Ledger.open(ledger.folder) as reader:
        assert reader.members["R3"] == KEYS["R3"].public
    ledger.expel("R3", OPERATOR_KEY, 4)
    with Ledger.open(ledger.folder, writable=True) as other:
        assert other.robots == ("R1", "R2")
        assert [t.sequence for t in other.history("R3")] == [0]
        for ask in (
            lambda: other.latest("R3"),
            lambda: other.publish("R3", KEYS["R3"], b"x", "time", 5),
            lambda: other.enrol("R3", random_key().public, OPERATOR_KEY, 5),
        ):
            with pytest.raises(errors.ExpelledMemberError):
                ask()


def test_a_reader_writes_nothing(folder: Path) -> None:
    with Ledger.open(folder) as ledger:
        for write in (
            lambda: ledger.publish("R1", KEYS["R1"], b"x", "time", 60),
            lambda: ledger.enrol("R4", KEYS["R3"].public, OPERATOR_KEY, 60),
            ledger.clean,
        ):
            with pytest.raises(errors.ReadOnlyError):
                write()
        with pytest.raises(sqlite3.OperationalError):
            ledger._db.execute("DELETE FROM blocks")


def test_a_closed_ledger_says_so(ledger: Ledger) -> None:
    ledger.close()
    ledger.close()
    with pytest.raises(errors.StorageError, match="closed"):
        ledger.publish("R1", KEYS["R1"], b"x", "time", 1)


def test_readers_see_what_others_append_when_they_refresh(ledger: Ledger) -> None:
    writer, folder = ledger, ledger.folder
    with Ledger.open(folder) as reader, Ledger.open(folder, writable=True) as second:
        writer.publish("R1", KEYS["R1"], b"one", "start", 1)
        assert reader.latest("R1") is None
        assert reader.refresh() == 1
        assert reader.latest("R1") == writer.latest("R1")
        second.publish("R2", KEYS["R2"], b"two", "start", 2)  # rebases by itself
        writer.publish("R1", KEYS["R1"], b"three", "time", 3)
        assert writer.head.height == 3
        assert reader.refresh() == 2
        assert reader.refresh() == 0
        assert reader.head == writer.head


def test_a_second_writer_waits_and_then_is_refused(folder: Path) -> None:
    with Ledger.open(folder, writable=True, wait_s=0.05) as ledger:
        other = sqlite3.connect(folder / DATABASE_NAME, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(errors.LedgerBusyError, match="another process"):
            ledger.publish("R1", KEYS["R1"], b"x", "time", 60)
        other.execute("ROLLBACK")
        other.close()
        ledger.publish("R1", KEYS["R1"], b"x", "time", 60)


def test_a_block_that_disappears_under_a_handle_is_noticed(folder: Path) -> None:
    with Ledger.open(folder, writable=True) as ledger:
        ledger._db.execute("DELETE FROM blocks WHERE height = 5")
        with pytest.raises(errors.DamagedError):
            ledger.refresh()


def test_creating_where_something_is(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "file").write_text("mine")
    (tmp_path / "empty").mkdir()
    before = files(tmp_path)
    for name in ("ledger", "other", "other/file"):
        with pytest.raises(errors.LedgerExistsError):
            new_ledger(tmp_path / name)
    assert files(tmp_path) == before
    new_ledger(tmp_path / "empty").close()
    new_ledger(tmp_path / "a" / "b").close()
    with pytest.raises(errors.RecordError):
        Ledger.create(tmp_path / "bad", {"a b": PUBLIC["R1"]}, OPERATOR_KEY)
    assert not (tmp_path / "bad").exists()


def test_creating_after_a_process_of_this_number_was_killed_at_it(tmp_path: Path) -> None:
    """In a container every process may have the same one."""
    draft = tmp_path / "new" / f".{DATABASE_NAME}.{os.getpid()}.new"
    draft.parent.mkdir()
    with closing(sqlite3.connect(draft)) as db:
        db.execute("CREATE TABLE blocks (height)")
    draft.with_name(f"{draft.name}-journal").write_bytes(b"half")
    Ledger.create(draft.parent, {}, OPERATOR_KEY).close()
    assert verify(draft.parent).ok and not list(draft.parent.glob(f"{draft.name}*"))


def test_of_two_that_create_one_ledger_one_does(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second one looked before the first was there; what a killed one left is no matter."""
    before = files(folder)
    monkeypatch.setattr("vrchain.ledger.storage.folder._check_room", lambda folder: False)
    with pytest.raises(errors.LedgerExistsError, match="meanwhile"):
        new_ledger(folder)
    assert files(folder) == before
    monkeypatch.undo()
    monkeypatch.setattr("os.link", Mock(side_effect=PermissionError("no links here")))
    new_ledger(tmp_path / "card").close()
    assert verify(tmp_path / "card").ok
    (tmp_path / "left").mkdir()
    (tmp_path / "left" / ".ledger.sqlite.123.new").write_bytes(b"half")
    new_ledger(tmp_path / "left").close()


def test_opening_what_is_no_ledger_creates_nothing(tmp_path: Path) -> None:
    for writable in (False, True):
        for name in ("", "missing"):
            with pytest.raises(errors.NotALedgerError, match="expected a ledger"):
                Ledger.open(tmp_path / name, writable)
    assert not list(tmp_path.iterdir())
    sqlite3.connect(tmp_path / DATABASE_NAME).execute("CREATE TABLE t (x)").connection.close()
    with pytest.raises(errors.NotALedgerError, match="application id"):
        Ledger.open(tmp_path)
    (tmp_path / DATABASE_NAME).write_bytes(b"garbage" * 1000)
    with pytest.raises(errors.DamagedError):
        Ledger.open(tmp_path)


def test_no_private_key_is_in_the_folder(folder: Path) -> None:
    secrets = [key.private.private_bytes_raw() for key in (*KEYS.values(), OPERATOR_KEY)]
    stored = b"".join(path.read_bytes() for path in folder.rglob("*") if path.is_file())
    assert PUBLIC["R1"].raw in stored
    assert not any(secret in stored for secret in secrets)


def test_two_fresh_processes_make_the_same_ledger(tmp_path: Path) -> None:
    code = (
        "import sys, pathlib, ledgers; print(ledgers.small_ledger(pathlib.Path(sys.argv[1])).hex())"
    )
    first = said_by(code, tmp_path / "one", hash_seed="1")
    assert first == said_by(code, tmp_path / "two", hash_seed="2")
    assert len(first) == 65
    one, two = (sqlite3.connect(tmp_path / name / DATABASE_NAME) for name in ("one", "two"))
    every = "SELECT * FROM records"
    assert one.execute(every).fetchall() == two.execute(every).fetchall()
