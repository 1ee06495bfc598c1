"""Servers that do not serve, each told in one line, and the folder stays; a cluster's commands."""

import contextlib
import json
import os
import shutil
import signal
import socket
import stat
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from clusters import (
    PATIENCE_S,
    emptied,
    eventually,
    making,
    pretended,
    skip_without_servers,
)
from ledgers import KEYS, OPERATOR_KEY, files, small_ledger
from typer.testing import CliRunner

from vrchain import extras
from vrchain.cli import app, ledger_keys
from vrchain.cli import cluster as cluster_cli
from vrchain.ledger import Ledger, errors, simulated_key, verify
from vrchain.ledger.cluster import servers as module
from vrchain.ledger.cluster.config import Node, Users, server_config
from vrchain.ledger.cluster.monitor import asked
from vrchain.ledger.cluster.servers import CONFIGURED, MARKER, Cluster, find_server
from vrchain.ledger.network.connection import Connection, Servers, nkey, token
from vrchain.ledger.network.log import put
from vrchain.ledger.network.opening import open_ledger
from vrchain.ledger.network.robot import RobotLedger
from vrchain.ledger.network.set_up import set_up
from vrchain.ledger.network.stream import Stream
from vrchain.ledger.rules.limits import UNLIMITED

USERS = Users(OPERATOR_KEY.public, {n: k.public for n, k in KEYS.items()}, frozenset({"R2"}))


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """One server that lets in members alone, with ``small_ledger``; R2 makes blocks."""
    skip_without_servers()
    folder = tmp_path_factory.mktemp("guarded")
    small_ledger(folder / "ledger")
    cluster = Cluster.make(folder / "servers", 1, USERS)
    operator = Servers.at(cluster.address, key=OPERATOR_KEY, name="operator")
    with cluster.running(OPERATOR_KEY, "operator"), Ledger.open(folder / "ledger") as ledger:
        with contextlib.closing(Stream(Connection(operator))) as stream:
            put(ledger, stream, -1)
        yield cluster


def newest(address: str, **options: object) -> int:
    servers = Servers.at(address, **({"timeout_s": 2.0} | options))
    with contextlib.closing(Stream(Connection(servers))) as stream:
        return stream.newest()


def test_a_member_and_a_maker_work_with_their_keys_alone(guarded: Cluster, tmp_path: Path) -> None:
    limits = replace(UNLIMITED, blob_bytes=1000)
    with (
        making(guarded.address, tmp_path / "R2", "R2", signs=True, limits=limits),
        open_ledger(guarded.address, tmp_path / "R1", key=KEYS["R1"], name="R1") as r1,
        open_ledger(guarded.address, tmp_path / "R3", key=KEYS["R3"], name="R3") as r3,
    ):
        assert isinstance(r1, RobotLedger) and isinstance(r3, RobotLedger)
        sent = r1.publish("R1", KEYS["R1"], b"payload", "view", 60)
        r1.wait(sent, timeout_s=PATIENCE_S)
        eventually(lambda: r3.refresh() or r3.latest("R1") == sent)
        eventually(lambda: r3.others.get("R1") == (r1.head.height, (0, 0, 0)), "heads are told")
        r3.publish("R1", KEYS["R1"], b"in another's place", "view", 70)
        with pytest.raises(errors.ClusterError, match=r"do not permit R3 to publish to offer\.R1"):
            r3.wait(timeout_s=PATIENCE_S)
        refused = r1.publish("R1", KEYS["R1"], bytes(2000), "view", 70)
        with pytest.raises(errors.RefusedError, match=r"of at most 1000, got .* 2000"):
            r1.wait(refused, timeout_s=PATIENCE_S)


def test_running_servers_let_a_new_member_in_and_an_expelled_one_no_more(
    tmp_path: Path,
) -> None:
    skip_without_servers()
    first, later = (Users(OPERATOR_KEY.public, {n: KEYS[n].public for n in names}, frozenset())
                    for names in (("R1", "R2"), ("R2", "R3")))  # fmt: skip
    cluster = Cluster.make(tmp_path / "servers", 1, first)
    with cluster.running(OPERATOR_KEY, "operator"):
        cluster.let_in(later)
        for name in ("R2", "R3"):
            assert newest(cluster.address, key=KEYS[name], name=name) == -1
        with pytest.raises(errors.ClusterError, match="let nobody in as R1"):
            newest(cluster.address, key=KEYS["R1"], name="R1")


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({}, "let nobody in as anyone: give the key"),
        ({"key": OPERATOR_KEY, "name": "R1"}, None),
        ({"key": KEYS["R1"], "name": "R1"}, None),
    ],
)
def test_who_comes_in(guarded: Cluster, options: dict[str, object], complaint: str | None) -> None:
    if complaint is None:
        assert newest(guarded.address, **options) >= 5
    else:
        with pytest.raises(errors.ClusterError, match=complaint):
            newest(guarded.address, **options)


def test_a_server_that_is_not_there(folder: Path, tmp_path: Path) -> None:
    """A new folder needs one; another reads on, and says what keeps it from the servers."""
    skip_without_servers()
    with socket.create_server(("127.0.0.1", 0)) as gone:
        address = f"nats://127.0.0.1:{gone.getsockname()[1]}"
    with pytest.raises(errors.UnavailableError, match=r"no answer from .*127\.0\.0\.1"):
        open_ledger(address, tmp_path / "new", timeout_s=0.5)
    assert not (tmp_path / "new").exists()
    with open_ledger(address, folder, timeout_s=0.5) as opened:
        assert isinstance(opened, RobotLedger)
        assert opened.payload(opened.history("R1")[0].payload_digest) == b"first of R1"
        with pytest.raises(errors.UnavailableError, match="no answer from"):
            opened.wait_until_followed(timeout_s=1.0)
    assert verify(folder).ok


@pytest.mark.parametrize(
    ("greeting", "complaint"),
    [
        ({"version": "2.9.10"}, r"version 2\.12\.0 or later, got 2\.9\.10 .*distribution"),
        ({"jetstream": False}, "expected servers with JetStream .*cluster config"),
    ],
)
def test_a_server_too_old_or_without_jetstream(
    greeting: dict[str, object], complaint: str, folder: Path
) -> None:
    skip_without_servers()
    with pretended(greeting) as address:
        with pytest.raises(errors.ClusterError, match=complaint):
            newest(address)
        with open_ledger(address, folder, timeout_s=2.0) as opened:
            assert isinstance(opened, RobotLedger)
            with pytest.raises(errors.ClusterError, match=complaint):
                opened.wait_until_followed(timeout_s=PATIENCE_S)
            assert opened.head.height == 5


def test_servers_without_a_ledger_with_another_and_full(
    servers: Cluster, folder: Path, tmp_path: Path
) -> None:
    async def delete(client: object) -> None:
        await client.jetstream().delete_stream("block")  # type: ignore[attr-defined]

    with contextlib.closing(Stream(Connection(Servers.at(servers.address)))) as stream:
        stream.connection.run(delete)
        with pytest.raises(errors.ClusterError, match="hold no ledger: vrchain cluster put"):
            stream.newest()
        set_up(stream.connection, 3, max_bytes=100_000)
        with Ledger.create(tmp_path / "other", {}, OPERATOR_KEY, name="other") as other:
            put(other, stream, -1)
            with (
                open_ledger(servers.address, folder) as opened,
                pytest.raises(errors.WrongLedgerError, match="hold another ledger"),
            ):
                assert isinstance(opened, RobotLedger)
                opened.wait_until_followed(timeout_s=PATIENCE_S)
            with pytest.raises(errors.ClusterError, match=r"are full .*make room"):
                for number in range(40):
                    other.enrol(f"{number}{'x' * 60}", KEYS["R3"].public, OPERATOR_KEY, number)
                for number in range(40):
                    put(other, stream, stream.newest())
                    other.drop_old(1, OPERATOR_KEY, 100)
                    key = KEYS["R3"]
                    other.publish(f"{number}{'x' * 60}", key, os.urandom(20_000), "view", 100)
        assert verify(tmp_path / "other").ok


@pytest.mark.parametrize(
    "address", ["nats:/host", "http://host", "nats://", "nats://a,,b", "nats://a b", "nats://u@h:1"]
)
def test_an_address_that_is_none(address: str) -> None:
    with pytest.raises(errors.ClusterError, match="expected nats://HOST,HOST,HOST"):
        Servers.at(address)


def test_without_the_library_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(errors.ClusterError, match=r"pip install 'nats-py==2\.16\.0'"):
        open_ledger("nats://localhost", folder)
    with Ledger.open(folder) as ledger:
        assert ledger.head.height == 5


def test_a_folder_has_to_be_given() -> None:
    with pytest.raises(errors.ClusterError, match="expected the folder of this machine's copy"):
        open_ledger("nats://localhost")


def fake_server(folder: Path, version: str) -> Path:
    folder.mkdir()
    path = folder / "nats-server"
    path.write_text(f"#!/bin/sh\necho nats-server: v{version}\n")
    path.chmod(0o755)
    return path


def test_the_installed_server_is_taken_first_if_it_is_new_enough(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    new, old = fake_server(tmp_path / "new", "2.99.0"), fake_server(tmp_path / "old", "2.9.10")
    monkeypatch.setenv("PATH", f"{new.parent}:{os.environ['PATH']}")
    assert find_server() == str(new)
    monkeypatch.setattr(module.sys, "executable", str(new.with_name("python")))
    monkeypatch.setenv("PATH", str(old.parent))
    assert find_server() == str(new)
    monkeypatch.setattr(module.sys, "executable", str(tmp_path / "python"))
    with pytest.raises(errors.ClusterError, match=r"old/nats-server has 2\.9\.10: pip install"):
        find_server()


def test_a_key_is_written_as_nats_does() -> None:
    """The example of NATS's own nkeys: public keys begin with U and have 56 letters."""
    written = nkey(KEYS["R1"].public)
    assert len(written) == 56 and written[0] == "U"
    assert token("a.b-c") == "a=b-c"
    config = json.loads(server_config(*_nodes(), Path("/store"), USERS))
    accounts = config["accounts"].values()
    users = {user["nkey"]: user["permissions"] for own in accounts for user in own["users"]}
    assert len(users) == len(accounts) == 4
    assert "block" not in users[written]["publish"]["allow"]
    assert "block" in users[nkey(KEYS["R2"].public)]["publish"]["allow"]
    assert config["jetstream"]["sync_interval"] == "always"


def _nodes() -> tuple[module.Node, list[module.Node]]:
    nodes = [module.Node(f"n{k}", f"10.0.0.{k}", 4222, 6222, 8222) for k in range(3)]
    return nodes[0], nodes


def vrchain(*words: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "vrchain", *map(str, words)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def said(*words: object, status: int = 0) -> str:
    """What a command prints, or its complaint."""
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert bool(done.exception) == bool(status), done.exception
    return done.output + str(done.exception or "")


def test_the_commands_of_a_cluster(folder: Path, tmp_path: Path) -> None:
    skip_without_servers()
    where = tmp_path / "servers"
    try:
        address = json.loads(said("cluster", "up", "-o", where, "--json"))["address"]
        assert json.loads(said("cluster", "up", "-o", where, "--json"))["address"] == address
        assert "put 6 blocks" in said("cluster", "put", folder, address, "--anonymous")
        assert "put 0 blocks" in said("cluster", "put", folder, address, "--anonymous")
        alone = "follows servers; what is written there alone"
        with (
            Ledger.open(folder, writable=True) as own,
            pytest.raises(errors.ClusterError, match=alone),
        ):
            own.enrol("R7", KEYS["R1"].public, OPERATOR_KEY, 100)
        assert "would be lost" in said(*configured(where, folder), status=1)
        assert "made with other --nodes:" in said(
            "cluster", "up", "-o", where, "--nodes", 5, status=1
        )
        assert said("cluster", "status", "-o", where).count("block 5, ") == 3
        cluster = Cluster.load(where)
        cluster.stop("n2", number=signal.SIGKILL)
        assert "n2 does not answer" in said("cluster", "status", "-o", where, status=1)
        eventually(lambda: any(row.get("block_leads") for row in cluster.status()))
        watched = said("ledger", "watch", address, "--folder", tmp_path / "copy", "--seconds", 3)
        assert "block 4 by R3: transaction 0 of R3" in watched
        with Ledger.create(tmp_path / "other", {}, OPERATOR_KEY, name="other"):
            pass
        words = ("ledger", "watch", address, "--folder", tmp_path / "other", "--seconds", 3)
        assert "hold another ledger" in said(*words, status=1)
        assert "ended 2 servers" in said("cluster", "down", "-o", where)
        assert left_in(where) == []
    finally:
        if (where / MARKER).exists():
            Cluster.load(where).stop()


def test_commands_that_write_go_through_the_servers(servers: Cluster, tmp_path: Path) -> None:
    team, keys = tmp_path / "team", ("--keys", tmp_path / "keys")
    said("ledger", "init", team, "--member", "R1", *keys)
    said("cluster", "put", team, servers.address, "--anonymous")
    said("ledger", "enroll", team, "R2", *keys, "--servers", servers.address)
    assert newest(servers.address) == 1
    assert "give --servers" in said("ledger", "expel", team, "R2", *keys, status=1)
    with making_with(servers.address, tmp_path, "R1"):
        (tmp_path / "file").write_bytes(b"payload")
        words = ("ledger", "append", team, "R2", tmp_path / "file", *keys)
        assert "transaction 0 of R2 in block 2" in said(*words, "--servers", servers.address)
    maker = tmp_path / "maker"
    assert "give --servers" in said("ledger", "enroll", maker, "R3", *keys, status=1)
    assert verify(team).ok and verify(maker).ok


def test_what_is_written_while_servers_are_away_goes_out_later_and_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    skip_without_servers()
    monkeypatch.setattr(ledger_keys, "_SOON_S", 0.5)
    team, keys = tmp_path / "team", ("--keys", tmp_path / "keys")
    said("ledger", "init", team, "--member", "R1", *keys)
    cluster = Cluster.make(tmp_path / "servers", 1)
    words = ("ledger", "append", team, "R1", tmp_path / "file", *keys, "--servers", cluster.address)
    with cluster.running():
        said("cluster", "put", team, cluster.address, "--anonymous", "--replicas", "1")
        (tmp_path / "file").write_bytes(b"of the day before")
        with making_with(cluster.address, tmp_path, "R1"):
            assert "transaction 0 of R1 in block 1" in said(*words)
        cluster.stop()
        monkeypatch.setattr(ledger_keys, "_LATE_S", 0.5)
        for number in (1, 2):
            (tmp_path / "file").write_bytes(b"of a day without servers %d" % number)
            row = json.loads(said(*words, "--json"))
            assert row["waits"] and row["sequence"] == number
        said("ledger", "expel", team, "R1", *words[5:], status=1)
        monkeypatch.undo()
        cluster.restart()
        with making_with(cluster.address, tmp_path, "R1"):
            (tmp_path / "file").write_bytes(b"of the next day")
            assert "transaction 3 of R1 in block" in said(*words)
    with Ledger.open(team) as opened:
        assert [t.reason for t in opened.history("R1")] == ["start", "time", "time", "time"]
    assert verify(team).ok


def test_a_bag_is_published_through_servers(tmp_path: Path) -> None:
    skip_without_servers()
    for needed in ("rosbags", "mcap"):
        pytest.importorskip(needed)
    from recordings import recording, write

    bag, team, keys = write(recording(), tmp_path / "bag"), tmp_path / "team", tmp_path / "keys"
    said("ledger", "init", team, "--member", "R1", "--member", "R2", "--keys", keys)
    cluster = Cluster.make(tmp_path / "servers", 1)
    more = ("--no-landmarks", "--keys", keys, "--servers", cluster.address)
    words = ("bag", "publish", bag, team, "--robot", "R1=/R1", *more)
    with cluster.running():
        said("cluster", "put", team, cluster.address, "--anonymous", "--replicas", "1")
        assert "expected one --robot" in said(*words, "--robot", "R2=/R2", status=1)
        with making_with(cluster.address, tmp_path, "R2"):
            assert "published 1 by start, 2 by view" in said(*words)
            assert "done before, published nothing new" in said(*words)
    with Ledger.open(team) as opened:
        assert [t.reason for t in opened.history("R1")] == ["start", "view", "view"]
    assert verify(team).ok


@contextlib.contextmanager
def making_with(address: str, folder: Path, robot: str) -> Iterator[None]:
    """``vrchain cluster make`` in a process of its own."""
    words = ["cluster", "make", address, "--folder", folder / "maker", "--robot", robot]
    process = vrchain(*words, "--keys", folder / "keys", "--anonymous")
    try:
        yield
        process.send_signal(signal.SIGINT)
        assert "interrupted" in process.communicate(timeout=PATIENCE_S)[1]
    finally:
        process.kill()
        process.wait()


def test_ctrl_c_while_servers_start_leaves_none(tmp_path: Path) -> None:
    skip_without_servers()
    process = vrchain("cluster", "up", "-o", tmp_path / "servers")
    eventually(lambda: list(tmp_path.glob("servers/*.pid")) or process.poll() is not None)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=PATIENCE_S)
    cluster = Cluster.load(tmp_path / "servers")
    try:
        if process.returncode == 0:  # it was ready before the signal came
            pytest.skip(f"too late: {out}")
        assert process.returncode == 130 and "interrupted" in err
        assert left_in(tmp_path) == []
    finally:
        cluster.stop()


def left_in(folder: Path) -> list[int]:
    """Processes that have to do with a folder, whoever noted them down."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if str(folder).encode() in path.read_bytes():
                found.append(int(path.parent.name))
    return found


def test_an_interrupt_as_servers_start_waits_until_they_are_noted_down(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    skip_without_servers()
    start = subprocess.Popen

    def interrupted(*words: object, **options: object) -> object:
        started = start(*words, **options)  # type: ignore[call-overload]
        if "-l" in words[0]:  # type: ignore[operator]
            signal.raise_signal(signal.SIGINT)
        return started

    cluster = Cluster.make(tmp_path / "servers")
    monkeypatch.setattr(module.subprocess, "Popen", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in background jobs
    try:
        with pytest.raises(KeyboardInterrupt), cluster.running():
            pass
    finally:
        signal.signal(signal.SIGINT, before)
    assert left_in(tmp_path) == []


def test_a_server_that_cannot_be_noted_down_is_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    skip_without_servers()
    cluster = Cluster.make(tmp_path / "servers", 1)
    monkeypatch.setattr(cluster, "_pid_file", lambda name: tmp_path / "no folder" / name)
    with pytest.raises(FileNotFoundError):
        cluster.start()
    assert left_in(tmp_path) == []


@pytest.mark.parametrize(
    "words", [b"SSH-2.0-x\r\n", b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\n{"]
)
def test_another_that_answers_in_a_servers_place_says_nothing(words: bytes) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:

        def answer() -> None:
            client, _ = other.accept()
            with client:
                client.recv(4096)
                client.sendall(words)

        threading.Thread(target=answer, daemon=True).start()
        assert asked(Node("n1", "127.0.0.1", 1, 2, other.getsockname()[1]), "healthz") == {}


def test_what_is_published_beside_putting_is_put_or_refused(
    servers: Cluster, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An acknowledged transaction that the servers never get would be lost to the team."""
    put, refused = cluster_cli.put_blocks, []

    def meanwhile(*given: object) -> int:
        with Ledger.open(folder, writable=True) as own, contextlib.suppress(errors.ClusterError):
            own.publish("R1", KEYS["R1"], b"meanwhile", "view", 100)
            refused.append(False)
        return put(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(cluster_cli, "put_blocks", meanwhile)
    emptied(servers)
    said("cluster", "put", folder, servers.address, "--anonymous")
    with Ledger.open(folder) as own:
        assert refused == [] and newest(servers.address) == own.head.height


def test_no_cluster_where_something_else_is(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    assert "is not empty" in said("cluster", "up", "-o", tmp_path, status=1)
    assert "expected a folder that" in said("cluster", "status", "-o", tmp_path, status=1)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_the_configuration_of_real_servers(folder: Path, tmp_path: Path) -> None:
    words = ["cluster", "config", "-o", tmp_path / "out", "--ledger", folder]
    words += [f"--server=n{k}=10.0.0.{k}" for k in (1, 2, 3)]
    assert "expected --maker" in said(*words, status=1)
    assert "NAME=HOST" in said(*words, "--maker", "R2", "--server", "n1", status=1)
    text = said(*words, "--maker", "R2", "--certificates", "/etc/vrchain")
    assert "tls://10.0.0.1:4222,10.0.0.2:4222,10.0.0.3:4222" in text
    config = json.loads((tmp_path / "out" / "n2.conf").read_text())
    assert config["tls"]["cert_file"] == "/etc/vrchain/n2.crt"
    assert config["cluster"]["tls"]["verify"] and config["max_payload"] == 8 << 20
    assert config["https"] == "10.0.0.2:8222" and "authorization" not in config["cluster"]
    assert len(config["accounts"]) == 4


def test_no_server_joins_that_does_not_know_the_others_secret(tmp_path: Path) -> None:
    """Its clients could write blocks, whoever they are."""
    skip_without_servers()
    cluster = Cluster.make(tmp_path / "servers", 3, USERS)
    assert {stat.S_IMODE(f.stat().st_mode) for f in cluster.folder.iterdir()} == {0o600}
    first = cluster.nodes[0]
    stranger = {
        "server_name": "x", "listen": "127.0.0.1:-1",
        "cluster": {"name": "vrchain", "listen": "127.0.0.1:-1",
                    "routes": [f"nats://{first.host}:{first.route_port}"]},
    }  # fmt: skip
    (tmp_path / "x.conf").write_text(json.dumps(stranger))
    with cluster.running(OPERATOR_KEY, "operator"):
        log = tmp_path / "x.log"
        other = subprocess.Popen([find_server(), "-c", tmp_path / "x.conf", "-l", log])
        try:
            eventually(lambda: log.exists() and "Authorization Violation" in log.read_text())
        finally:
            other.kill()
            other.wait()
        routed = {r["remote_name"] for r in asked(first, "routez")["routes"]}
        assert routed == {"n2", "n3"}
    assert Cluster.load(cluster.folder).secret == cluster.secret != ""


def test_servers_over_tls_say_how_they_are_and_keep_what_they_were_told(
    folder: Path, tmp_path: Path
) -> None:
    skip_without_servers()
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed, which makes the certificates")
    made = tmp_path / "certificates"
    made.mkdir()
    names = ["-addext", "subjectAltName=IP:127.0.0.1", "-subj", "/CN=n1", "-days", "2", "-nodes"]
    files = ["-keyout", made / "n1.key", "-out", made / "n1.crt"]
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", *names, *files],
        check=True,
        capture_output=True,
    )
    shutil.copy(made / "n1.crt", made / "ca.crt")
    out, store = tmp_path / "out", tmp_path / "store"
    words = configured(out, folder, "n1=127.0.0.1")
    said(*words, "--certificates", made, "--store", store)
    config = json.loads((out / "n1.conf").read_text())
    cluster = Cluster.load(out, CONFIGURED)
    free = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
    port, monitor = (s.getsockname()[1] for s in free)
    [s.close() for s in free]
    config |= {"listen": f"127.0.0.1:{port}", "https": f"127.0.0.1:{monitor}"}
    (out / "n1.conf").write_text(json.dumps(config))
    node = replace(cluster.nodes[0], port=port, monitor_port=monitor)
    told = {"nodes": [asdict(node)], "ca": cluster.ca}
    (out / CONFIGURED).write_text(json.dumps(told))
    address = f"tls://127.0.0.1:{port}"
    server = subprocess.Popen([find_server(), "-c", out / "n1.conf", "-l", tmp_path / "log"])
    try:
        eventually(lambda: Cluster.load(out, CONFIGURED).status()[0]["runs"])
        put_it = ["cluster", "put", folder, address, "--simulated", 0, "--ca", made / "ca.crt"]
        said(*put_it, "--max-gb", "0.5")
        said(*put_it)  # as when they have lost some
        assert "n1" in said("cluster", "status", "-o", out)
        with closing(Stream(Connection(Servers.at(
            address, key=OPERATOR_KEY, name="operator", ca=made / "ca.crt"
        )))) as stream:  # fmt: skip
            config = stream.connection.run(lambda client: client.jetstream().stream_info("block"))
            assert config.config.max_bytes == 500_000_000 and config.config.num_replicas == 1
        assert "give --ca" in said("cluster", "status", "-o", out, "--ca", "none", status=1)
    finally:
        server.kill()
        server.wait()


def test_what_is_no_block_is_told_and_nobody_takes_it_in(address: str, folder: Path) -> None:
    """By a dishonest maker, or whoever runs the servers."""

    async def garbage(client: object) -> None:
        await client.jetstream().publish("block", b"garbage")  # type: ignore[attr-defined]

    with closing(Stream(Connection(Servers.at(address)))) as stream:
        stream.connection.run(garbage)
    told = said("cluster", "put", folder, address, "--anonymous", status=1)
    assert "after block 5 is no block of this chain" in told and "put the ledger again" in told


def configured(out: Path, ledger: Path, *servers: str) -> list[object]:
    """The command that writes configurations, for three machines where nobody listens."""
    servers = servers or tuple(f"n{k}=127.0.0.{k}" for k in (2, 3, 4))
    words: list[object] = ["cluster", "config", "-o", out, "--ledger", ledger, "--maker", "R2"]
    return words + [f"--server={server}" for server in servers]


def test_config_leaves_a_cluster_s_folder_alone(folder: Path, tmp_path: Path) -> None:
    """Its stores, logs and pid files were lost."""
    cluster = Cluster.make(tmp_path / "servers")
    for name in ("n1/jetstream/1.blk", "n1.pid", "n1.log"):
        (cluster.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (cluster.folder / name).write_text("kept")
    (tmp_path / "link").symlink_to(cluster.folder)
    before = files(tmp_path)
    for out in (cluster.folder, tmp_path / "link"):
        assert "choose another -o" in said(*configured(out, folder), status=1)
        assert files(tmp_path) == before
    assert Cluster.load(cluster.folder).nodes == cluster.nodes


def test_config_again_does_not_take_keys_that_lie_beside_it(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    said(*configured(out, folder))
    (out / "n2.key").write_text("secret")
    before = files(out)
    assert "holds n2.key, which would be lost" in said(*configured(out, folder), status=1)
    assert files(out) == before
    (out / "n2.key").unlink()
    said(*configured(out, folder))


def test_up_and_down_leave_what_config_wrote_alone(folder: Path, tmp_path: Path) -> None:
    """``status`` asks the machines; ``config`` again writes it anew."""
    out = tmp_path / "out"
    said(*configured(out, folder))
    before = files(tmp_path)
    assert set(files(out)) == {"n2.conf", "n3.conf", "n4.conf", CONFIGURED}
    complaint = said("cluster", "up", "-o", out, status=1)
    assert "wrote for other machines: choose another -o" in complaint
    assert "expected a folder that vrchain cluster up" in said(
        "cluster", "down", "-o", out, status=1
    )
    told = said("cluster", "status", "-o", out, status=1)
    assert [f"n{k} does not answer" in told for k in (2, 3, 4)] == [True] * 3
    assert files(tmp_path) == before
    said(*configured(out, folder, "one=127.0.0.2"))
    assert set(files(out)) == {"one.conf", CONFIGURED}
    assert "cluster" not in json.loads((out / "one.conf").read_text())
    (out / CONFIGURED).write_text("{")
    told = said("cluster", "status", "-o", out, status=1)
    assert "expected a folder that vrchain cluster config -o made" in told


@pytest.mark.parametrize(
    ("servers", "complaint"),
    [
        (["../a=h"], "expected 1 to 64 letters"),
        (["n1=a", "n2=b", "{tmp}/n3=c"], "expected 1 to 64 letters"),
        (["n1=a", "n2=b", ".n3=c"], "expected 1 to 64 letters"),
        (["n1=a", "n2=b", "n 3=c"], "expected 1 to 64 letters"),
        (["n1=a", "n2=b", "n2=c"], "each name once"),
        (["n1=a", "n2=b", "n3"], "NAME=HOST"),
        (["n1=a", "n2=b", "=c"], "NAME=HOST"),
        (["n1=a", "n2=b"], "expected three or five --server, or one to try, got 2"),
        ([f"n{k}=h{k}" for k in range(6)], "got 6"),
    ],
)
def test_servers_that_cannot_be_configured(
    servers: list[str], complaint: str, folder: Path, tmp_path: Path
) -> None:
    servers = [server.format(tmp=tmp_path) for server in servers]
    earlier = tmp_path / "earlier"
    said(*configured(earlier, folder))
    before, names = files(tmp_path), sorted(tmp_path.iterdir())
    for out in (earlier, tmp_path / "new"):
        told = said(*configured(out, folder, *servers), status=1)
        assert complaint in told and "\n" not in told
        assert files(tmp_path) == before and sorted(tmp_path.iterdir()) == names


@pytest.mark.parametrize(
    ("words", "options"),
    [
        (["--nodes", "5"], "--nodes"),
        (["--nodes", "3"], "--nodes"),  # what a new one has
        (["--host", "127.0.0.2"], "--host"),
        (["--ledger", "{ledger}"], "--ledger"),
        (["--ledger", "{ledger}", "--maker", "R2", "--simulated", "0"], "--ledger"),
        (["--nodes", "2", "--host", "::1"], "--nodes, --host"),
    ],
)
def test_a_cluster_that_is_there_gets_no_other_options(
    words: list[str], options: str, folder: Path, tmp_path: Path
) -> None:
    cluster = Cluster.make(tmp_path / "servers", 1)
    before = files(tmp_path)
    words = [word.format(ledger=folder) for word in words]
    told = said("cluster", "up", "-o", cluster.folder, *words, status=1)
    assert f"was made with other {options}: " in told and "vrchain cluster down" in told
    assert "\n" not in told and files(tmp_path) == before


def test_a_cluster_of_members_goes_on_with_its_ledger_alone(folder: Path, tmp_path: Path) -> None:
    skip_without_servers()
    where = tmp_path / "servers"
    up = ("cluster", "up", "-o", where, "--simulated", 0)
    own, new = ("--ledger", folder, "--maker", "R2"), simulated_key(0, "R9")
    with Ledger.create(tmp_path / "other", {"R2": KEYS["R2"].public}, OPERATOR_KEY, name="other"):
        pass
    try:
        address = json.loads(said(*up, *own, "--nodes", 1, "--json"))["address"]
        before = {path.name: path.read_bytes() for path in where.glob("n1.[cp]*")}
        assert set(before) == {"n1.conf", "n1.pid"}
        other = ("--ledger", tmp_path / "other", "--maker", "R2")
        assert "made with other --ledger: " in said(*up, *other, status=1)
        assert "--maker needs --ledger" in said(*up, "--maker", "R2", status=1)
        assert {path.name: path.read_bytes() for path in where.glob("n1.[cp]*")} == before
        assert newest(address, key=OPERATOR_KEY, name="operator") == -1
        said("cluster", "down", "-o", where)
        with Ledger.open(folder, writable=True) as ledger:
            ledger.enrol("R9", new.public, OPERATOR_KEY, 100)
        for words in (own, (*own, "--nodes", 1, "--host", "127.0.0.1")):  # stopped, and running
            assert json.loads(said(*up, *words, "--json"))["address"] == address
            assert newest(address, key=new, name="R9") == -1
        said(*up, "--ledger", folder, "--maker", "R1")
        users = Users(OPERATOR_KEY.public, {**USERS.members, "R9": new.public}, frozenset({"R1"}))
        assert Cluster.load(where).lets_in(users)
    finally:
        if (where / MARKER).exists():
            Cluster.load(where).stop()
