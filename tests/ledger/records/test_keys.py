"""Signing keys: simulated ones say so, live ones are files that only their owner reads."""

import os
import stat
from pathlib import Path

import pytest

from vrchain.ledger import Ledger, load_key, random_key, save_key, simulated_key
from vrchain.ledger.errors import KeyFileError, RecordError
from vrchain.ledger.records.keys import PublicKey


def test_simulated_keys_follow_from_seed_and_name() -> None:
    key = simulated_key(0, "R1")
    assert (
        key.public.raw.hex() == "c75aa259da6630183903efb30216429ff33fa39c104de70562817a3ce92c9d47"
    )
    assert key.public.insecure
    assert simulated_key(0, "R1").public == key.public
    assert len({simulated_key(s, n).public.raw for s in (0, 1, -1) for n in ("R1", "R2")}) == 6


def test_a_signature_holds_for_its_key_and_bytes_only() -> None:
    key = random_key()
    signature = key.sign(b"data")
    assert key.public.accepts(b"data", signature)
    assert not key.public.accepts(b"Data", signature)
    assert not random_key().public.accepts(b"data", signature)
    for bad in (b"", signature[:-1], signature + b"\0", bytes(64)):
        assert not key.public.accepts(b"data", bad)
    assert not PublicKey(bytes(32)).accepts(b"data", signature)
    with pytest.raises(RecordError):
        PublicKey(bytes(31))


def test_live_keys_are_random_and_read_back(tmp_path: Path) -> None:
    key = random_key()
    assert not key.public.insecure
    assert key.public != random_key().public
    old = os.umask(0)
    try:
        save_key(key, tmp_path / "keys" / "R1.pem")
    finally:
        os.umask(old)
    path = tmp_path / "keys" / "R1.pem"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert load_key(path).sign(b"data") == key.sign(b"data")
    assert "private" not in repr(key).lower()


def test_where_keys_are_never_saved(tmp_path: Path, ledger: Ledger) -> None:
    with pytest.raises(KeyFileError, match="simulated"):
        save_key(simulated_key(0, "R1"), tmp_path / "R1.pem")
    assert not (tmp_path / "R1.pem").exists()
    save_key(random_key(), tmp_path / "R1.pem")
    before = (tmp_path / "R1.pem").read_bytes()
    with pytest.raises(KeyFileError, match="never overwritten"):
        save_key(random_key(), tmp_path / "R1.pem")
    assert (tmp_path / "R1.pem").read_bytes() == before
    (tmp_path / "link").symlink_to(ledger.folder)
    for inside in ("ledger/R1.pem", "ledger/keys/R1.pem", "link/R1.pem", "ledger/blobs/../R1.pem"):
        with pytest.raises(KeyFileError, match="outside"):
            save_key(random_key(), tmp_path / inside)
    assert not list((tmp_path / "ledger").rglob("*.pem"))


def test_what_is_no_private_key_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "R1.pem"
    save_key(random_key(), path)
    for spoil, said in (
        (lambda: path.chmod(0o640), "chmod 600"),
        (lambda: (path.chmod(0o600), path.write_bytes(b"no key")), "expected an Ed25519"),
        (path.unlink, "No such file"),
    ):
        spoil()
        with pytest.raises(KeyFileError, match=said):
            load_key(path)


def test_an_interrupt_leaves_no_half_written_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(handle: int) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(os, "fsync", interrupted)
        save_key(random_key(), tmp_path / "R1.pem")
    save_key(random_key(), tmp_path / "R1.pem")
