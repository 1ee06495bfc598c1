"""A robot's ledger over servers: offers and a maker, the outbox, a backup, what is refused."""

import contextlib
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from clusters import PATIENCE_S, Proxy, eventually, making
from ledgers import KEYS, OPERATOR_KEY

from vrchain.ledger import Ledger, Limits, errors, verify
from vrchain.ledger.cluster.servers import Cluster
from vrchain.ledger.network.connection import Connection, Servers
from vrchain.ledger.network.message import Standing, pack_entry, pack_head
from vrchain.ledger.network.opening import open_ledger
from vrchain.ledger.network.robot import RobotLedger
from vrchain.ledger.network.stream import Stream
from vrchain.ledger.records.encoding import encode_fields


def stream_of(address: str) -> Stream:
    return Stream(Connection(Servers.at(address)))


def robot_at(address: str, folder: Path, **options: object) -> RobotLedger:
    opened = open_ledger(address, folder, **options)  # type: ignore[arg-type]
    assert isinstance(opened, RobotLedger)
    return opened


def test_what_a_robot_publishes_is_in_every_folder(address: str, tmp_path: Path) -> None:
    with (
        making(address, tmp_path / "maker"),
        robot_at(address, tmp_path / "R1") as r1,
        robot_at(address, tmp_path / "R3") as r3,
    ):
        sent = [r1.publish("R1", KEYS["R1"], f"{k}".encode(), "view", 60 + k) for k in range(20)]
        seen = r3.publish("R3", KEYS["R3"], b"of R3", "view", 60, landmarks=b"seen")
        r1.wait(timeout_s=PATIENCE_S)
        r3.wait(timeout_s=PATIENCE_S)
        eventually(lambda: r3.refresh() or r3.latest("R1") == sent[-1])
        assert r3.history("R1")[2:] == sent
        assert r3.payload(sent[7].payload_digest) == b"7"
        eventually(lambda: r1.refresh() or r1.latest("R3") == seen)
        assert r1.payload(seen.landmarks_digest) == b"seen"
        assert r1.outbox.count() == r3.outbox.count() == 0
        assert r1.head == r3.head and r1.alarms == []
    assert all(verify(tmp_path / name).ok for name in ("R1", "R3", "maker"))


def test_reads_are_the_folders_own(address: str, tmp_path: Path) -> None:
    """Another process opens the folder as it opens any other."""
    with robot_at(address, tmp_path / "R1") as r1, Ledger.open(tmp_path / "R1") as reader:
        r1.wait_until_followed()
        assert reader.refresh() == 5
        assert type(r1).latest is Ledger.latest and type(r1).payload is Ledger.payload


def test_a_robot_that_is_cut_off_reads_on_and_its_outbox_goes_out_once_and_in_order(
    address: str, servers: Cluster, tmp_path: Path
) -> None:
    proxy = Proxy(servers.nodes[0].address)
    with (
        contextlib.closing(proxy),
        making(address, tmp_path / "maker") as maker,
        robot_at(proxy.address, tmp_path / "R1", timeout_s=1.0) as r1,
        robot_at(address, tmp_path / "R3") as r3,
    ):
        first = r1.publish("R1", KEYS["R1"], b"before", "view", 60)
        r1.wait(timeout_s=PATIENCE_S)
        proxy.cut()
        sent = [r1.publish("R1", KEYS["R1"], f"{k}".encode(), "view", 70 + k) for k in range(30)]
        other = r3.publish("R3", KEYS["R3"], b"meanwhile", "view", 80)
        r3.wait(timeout_s=PATIENCE_S)
        assert r1.latest("R1") == first and r1.payload(first.payload_digest) == b"before"
        assert r1.outbox.count() == 30
        with pytest.raises(errors.UnavailableError, match=r"no answer from|still wait"):
            r1.wait(timeout_s=0.1)
        proxy.mend()
        r1.wait(timeout_s=PATIENCE_S)
        eventually(lambda: (r1.refresh(), len(r1.history("R1")) == 33)[1])
        assert r1.history("R1")[2:] == [first, *sent]
        eventually(lambda: (r1.refresh(), r1.latest("R3") == other)[1])
        assert maker.counts["appended"] == 32


def test_what_waits_goes_out_after_the_robots_process_has_been_killed(
    address: str, servers: Cluster, tmp_path: Path
) -> None:
    """It was signed without a network: a transaction is not refused for its age."""
    code = (
        "import os, sys\n"
        "sys.path[:0] = sys.argv[3:]\n"
        "from ledgers import KEYS\n"
        "from vrchain.ledger.network.opening import open_ledger\n"
        "opened = open_ledger(sys.argv[1], sys.argv[2], timeout_s=0.5)\n"
        "for k in range(5):\n"
        "    opened.publish('R1', KEYS['R1'], b'%d' % k, 'view', 60 + k)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    with robot_at(address, tmp_path / "R1") as r1:
        r1.publish("R1", KEYS["R1"], b"settled", "view", 55)  # so that it may sign offline
        r1.wait_until_followed()
    proxy = Proxy(servers.nodes[0].address)
    proxy.cut()
    tests = str(Path(__file__).parents[2])
    with contextlib.closing(proxy):
        child = [sys.executable, "-c", code, proxy.address, str(tmp_path / "R1"), *sys.path, tests]
        assert subprocess.run(child, check=False, timeout=PATIENCE_S).returncode == -9
    with making(address, tmp_path / "maker"), robot_at(address, tmp_path / "R1") as r1:
        r1.wait(timeout_s=PATIENCE_S)
        payloads = [r1.payload(t.payload_digest) for t in r1.history("R1")[2:]]
    assert payloads == [b"settled", b"0", b"1", b"2", b"3", b"4"]


def test_a_robot_restored_from_a_backup_reads_the_chain_before_it_signs(
    address: str, servers: Cluster, tmp_path: Path
) -> None:
    with making(address, tmp_path / "maker") as maker:
        with robot_at(address, tmp_path / "R1") as r1:
            r1.publish("R1", KEYS["R1"], b"0", "view", 60)
            r1.wait(timeout_s=PATIENCE_S)
        shutil.copytree(tmp_path / "R1", tmp_path / "backup")
        with robot_at(address, tmp_path / "R1") as r1:
            r1.publish("R1", KEYS["R1"], b"1", "view", 61)
            r1.wait(timeout_s=PATIENCE_S)
        proxy = Proxy(servers.nodes[0].address)
        with contextlib.closing(proxy):
            proxy.cut()
            with robot_at(proxy.address, tmp_path / "backup", timeout_s=0.5) as restored:
                with pytest.raises(errors.NotSettledError, match="read the chain first"):
                    restored.publish("R1", KEYS["R1"], b"2", "view", 62)
                assert restored.outbox.count() == 0
                proxy.mend()
                eventually(lambda: _publishes(restored, b"2"))
                restored.wait(timeout_s=PATIENCE_S)
                payloads = [restored.payload(t.payload_digest) for t in restored.history("R1")[2:]]
    assert payloads == [b"0", b"1", b"2"]
    assert set(maker.counts) == {"appended"}


def _publishes(ledger: RobotLedger, payload: bytes) -> bool:
    with contextlib.suppress(errors.NotSettledError):
        ledger.publish("R1", KEYS["R1"], payload, "view", 62)
        return True
    return False


def test_offers_that_a_restored_robot_does_not_know_hold_it_up(
    address: str, tmp_path: Path
) -> None:
    """They are on the servers, and in no block yet."""
    with robot_at(address, tmp_path / "R1") as r1:
        r1.wait_until_followed()
        shutil.copytree(tmp_path / "R1", tmp_path / "backup")
        r1.publish("R1", KEYS["R1"], b"0", "view", 60)
        eventually(lambda: r1.post.offers_of("R1") == 1)
    with robot_at(address, tmp_path / "backup") as restored:
        with pytest.raises(errors.NotSettledError, match="offers of R1 wait"):
            restored.publish("R1", KEYS["R1"], b"1", "view", 61)
        with making(address, tmp_path / "maker"):
            eventually(lambda: _publishes(restored, b"1"))
            restored.wait(timeout_s=PATIENCE_S)
        assert [t.sequence for t in restored.history("R1")] == [0, 1, 2, 3]


def test_a_number_is_used_once_whatever_comes_into_the_chain_meanwhile(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The transaction before is taken in, and leaves the outbox, while the next one is signed."""
    with making(address, tmp_path / "maker") as maker, robot_at(address, tmp_path / "R1") as r1:
        r1.publish("R1", KEYS["R1"], b"0", "view", 60)
        read = r1.refresh

        def read_and_wait() -> int:
            count = read()
            eventually(lambda: r1.outbox.count() == 0)
            return count

        monkeypatch.setattr(r1, "refresh", read_and_wait)
        r1.publish("R1", KEYS["R1"], b"1", "view", 61)
        monkeypatch.undo()
        r1.wait(timeout_s=PATIENCE_S)
        assert [t.sequence for t in r1.history("R1")] == [0, 1, 2, 3]
    assert set(maker.counts) == {"appended"}


def test_what_another_member_signs_beside_the_chain_holds_up_nobody(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with robot_at(address, tmp_path / "R1") as r1:
        r1.wait_until_followed()
        block = r1.entry(1).block
        heads = [
            ("R2", pack_head(replace(block, author="R2", timestamp_ns=k).signed(KEYS["R2"]),
                             Standing(0)))
            for k in range(3)
        ]  # fmt: skip
        heads.append(("R3", encode_fields("vrchain/2/message/head", bytes(2 << 20), 0, 0, 0)))
        monkeypatch.setattr(r1.post, "heads", lambda: heads)
        for _ in range(3):
            r1.wait_until_followed()
        eventually(lambda: len(r1.alarms) == 1)
        assert r1.trouble == {}


def test_whatever_goes_wrong_with_following_is_told_and_does_not_end_it(
    address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with making(address, tmp_path / "maker"), robot_at(address, tmp_path / "R1") as r1:
        r1.wait_until_followed(PATIENCE_S)

        def broken() -> list[tuple[str, bytes]]:
            raise FileNotFoundError("gone")

        monkeypatch.setattr(r1.post, "heads", broken)
        eventually(lambda: "gone" in str(r1.trouble.get("_follow", "")))
        monkeypatch.undo()
        eventually(lambda: not r1.trouble)
        r1.publish("R1", KEYS["R1"], b"goes on", "view", 60)
        r1.wait(timeout_s=PATIENCE_S)


def test_who_has_to_connect_anew_hears_again(address: str, tmp_path: Path) -> None:
    """As when servers answer by an error that their client gives up at."""
    reader = stream_of(address)
    with (
        contextlib.closing(reader),
        making(address, tmp_path / "maker") as maker,
        robot_at(address, tmp_path / "R1") as r1,
    ):
        r1.publish("R1", KEYS["R1"], b"before", "view", 60)
        r1.wait(timeout_s=PATIENCE_S)
        reader.heads()  # it listens from now on
        for connection in (maker._offers._connection, r1.post.connection, reader.connection):
            connection.run(lambda client: client.close())
        r1.publish("R1", KEYS["R1"], b"after", "view", 61)
        r1.wait(timeout_s=PATIENCE_S)
        reader.heads()  # it has connected by now
        r1.publish("R1", KEYS["R1"], b"heard", "view", 62)
        eventually(reader.heads)


def test_another_transaction_of_that_number_is_not_this_one(address: str, tmp_path: Path) -> None:
    with making(address, tmp_path / "maker"), robot_at(address, tmp_path / "R1") as r1:
        sent = r1.publish("R1", KEYS["R1"], b"sent", "view", 60)
        r1.wait(sent, PATIENCE_S)
        other = replace(sent, timestamp_ns=61).signed(KEYS["R1"])
        with pytest.raises(errors.UnavailableError):
            r1.wait(other, timeout_s=0.2)


def test_two_makers_share_the_work_and_no_offer_is_lost_or_doubled(
    address: str, tmp_path: Path
) -> None:
    with (
        making(address, tmp_path / "one", "R1") as one,
        making(address, tmp_path / "two", "R2") as two,
        robot_at(address, tmp_path / "R1") as r1,
        robot_at(address, tmp_path / "R3") as r3,
    ):
        for number in range(25):
            r1.publish("R1", KEYS["R1"], b"%d" % number, "view", 60 + number)
            r3.publish("R3", KEYS["R3"], b"%d" % number, "view", 60 + number)
        r1.wait(timeout_s=PATIENCE_S)
        r3.wait(timeout_s=PATIENCE_S)
        r1.wait_until_followed()
        assert [len(r1.history(r)) for r in ("R1", "R3")] == [27, 26]
        eventually(lambda: one.counts["appended"] + two.counts["appended"] == 50)


def test_a_robot_over_its_rate_waits_and_loses_nothing(address: str, tmp_path: Path) -> None:
    limits = Limits(rate_per_s=20.0, burst=2)
    with (
        making(address, tmp_path / "maker", limits=limits) as maker,
        robot_at(address, tmp_path / "R1") as r1,
    ):
        sent = [r1.publish("R1", KEYS["R1"], b"%d" % k, "view", 60 + k) for k in range(12)]
        r1.wait(timeout_s=PATIENCE_S)
        assert r1.history("R1")[2:] == sent
    assert maker.counts["RateLimitError"] > 0


def test_an_expelled_robots_offers_stay_and_it_is_told(address: str, tmp_path: Path) -> None:
    with making(address, tmp_path / "maker"), robot_at(address, tmp_path / "R1") as r1:
        r1.wait_until_followed()
        r1.expel("R3", OPERATOR_KEY, 60)
        with robot_at(address, tmp_path / "R3") as r3:
            r3.wait_until_followed()
            with pytest.raises(errors.ExpelledMemberError):
                r3.publish("R3", KEYS["R3"], b"payload", "view", 60)


def test_one_process_publishes_from_a_folder(address: str, tmp_path: Path) -> None:
    with (
        robot_at(address, tmp_path / "R1"),
        pytest.raises(errors.LedgerBusyError, match="a folder of its own"),
    ):
        open_ledger(address, tmp_path / "R1")


def test_a_block_that_the_servers_lost_comes_from_another_robots_folder(
    address: str, servers: Cluster, tmp_path: Path
) -> None:
    """The stream is rewritten with something else in the place of a block."""
    with robot_at(address, tmp_path / "R1") as r1:
        r1.wait_until_followed()

    async def spoil(client: object) -> None:
        stream = client.jetstream()  # type: ignore[attr-defined]
        await stream.delete_stream("block")

    with contextlib.closing(stream_of(address)) as stream:
        stream.connection.run(spoil)
        servers.set_up()
        with Ledger.open(tmp_path / "R1") as ledger:
            for entry in ledger.entries():
                blobs = {} if entry.block.height == 3 else ledger.blobs_of(entry)
                stream.append(
                    entry, blobs if entry.block.height != 4 else {}, entry.block.height - 1
                )
    with robot_at(address, tmp_path / "alone") as alone:
        with pytest.raises(
            errors.GapError, match=r"127\.0\.0\.1:\d+: block 4 .*another robot's folder"
        ):
            alone.wait_until_followed()
        assert alone.head.height == 3 and verify(tmp_path / "alone").ok
    with robot_at(address, tmp_path / "alone", others=[tmp_path / "R1"]) as helped:
        helped.wait_until_followed()
        assert helped.head.height == 5
        asked = {f"by way of {node.address}" for node in servers.nodes}
        assert {alarm.partition(": block 4 ")[0] for alarm in helped.alarms} == asked
    assert verify(tmp_path / "alone").ok


def test_that_servers_lack_a_block_is_told_though_another_robot_has_it(
    address: str, servers: Cluster, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A stream that its operator may delete from, with a hole, as a lost block leaves one."""
    with robot_at(address, tmp_path / "R1") as r1, robot_at(address, tmp_path / "R3") as r3:
        r1.wait_until_followed()
        r3.wait_until_followed()

    async def spoil(client: object) -> None:
        stream = client.jetstream()  # type: ignore[attr-defined]
        await stream.delete_stream("block")
        await stream.add_stream(name="block", subjects=["block"], num_replicas=3, allow_direct=True)
        with Ledger.open(tmp_path / "R1") as ledger:
            for entry in ledger.entries():
                await stream.publish("block", pack_entry(entry, ledger.blobs_of(entry)))
        await stream.delete_msg("block", 4)

    with contextlib.closing(stream_of(address)) as stream:
        stream.connection.run(spoil)
        eventually(lambda: [given for _, given in stream.copies(3)] == [None] * 3)
    with (
        robot_at(address, tmp_path / "new", name="R2", others=[tmp_path / "R1"]) as new,
        robot_at(address, tmp_path / "R3", name="R3") as r3,
    ):
        new.wait_until_followed(PATIENCE_S)
        assert new.head.height == 5
        assert [a.split(": ", 1)[1] for a in new.alarms] == ["block 3 is missing"] * 3
        asked = {f"by way of {node.address}" for node in servers.nodes}
        assert {a.partition(": ")[0] for a in new.alarms} == asked
        eventually(lambda: r3.others.get("R2") == (5, (0, 0, 3)), "others hear of it")
    assert sum("block 3 is missing" in message for message in caplog.messages) == 3


def test_two_halves_of_a_team_that_were_cut_from_each_other_merge(
    address: str, servers: Cluster, tmp_path: Path
) -> None:
    """R1 and R3 lose sight of two servers, the third is down; R2 and the maker go on."""
    proxies = [Proxy(node.address) for node in servers.nodes[:2]]
    beyond = ",".join(proxy.address.removeprefix("nats://") for proxy in proxies)
    members = {"R1": f"nats://{beyond}", "R2": address, "R3": f"nats://{beyond}"}
    numbers = range(12)
    with contextlib.ExitStack() as stack:
        for proxy in proxies:
            stack.enter_context(contextlib.closing(proxy))
        maker = stack.enter_context(making(address, tmp_path / "maker"))
        team = {
            name: stack.enter_context(robot_at(where, tmp_path / name, timeout_s=2.0))
            for name, where in members.items()
        }
        sent = {name: [r.publish(name, KEYS[name], b"0", "view", 60)] for name, r in team.items()}
        for robot in team.values():
            robot.wait(timeout_s=PATIENCE_S)
        for proxy in proxies:
            proxy.cut()
        servers.stop(servers.nodes[2].name)
        for number in numbers:
            for name, robot in team.items():
                payload = f"{name} {number}".encode()
                sent[name].append(robot.publish(name, KEYS[name], payload, "view", 70 + number))
        team["R2"].wait(timeout_s=PATIENCE_S)
        for name in ("R1", "R3"):
            assert team[name].outbox.count() == len(numbers)
            assert team[name].latest(name) == sent[name][0]
        for proxy in proxies:
            proxy.mend()
        servers.restart(servers.nodes[2].name)
        for robot in team.values():
            robot.wait(timeout_s=PATIENCE_S)
        newest = {name: own[-1] for name, own in sent.items()}
        for robot in team.values():
            eventually(
                lambda r=robot: r.refresh() or {n: r.latest(n) for n in newest} == newest,
                "everyone has everyone's newest",
            )
            for name, own in sent.items():
                assert robot.history(name)[-len(own) :] == own
            assert len([r for e in robot.entries() for r in e.records]) == 6 + 3 * 13
        assert len({robot.head.hash for robot in team.values()}) == 1
        eventually(lambda: maker.counts["appended"] == 3 * 13)
    assert all(verify(tmp_path / name).ok for name in (*members, "maker"))
