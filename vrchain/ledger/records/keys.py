"""Ed25519 keys: simulated ones derive from a seed and say so, live ones are random files.

A signing key never goes into a ledger: records hold public keys only, and ``save_key``
refuses to write inside a ledger's folder.
"""

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
)

from vrchain.ledger.errors import KeyFileError
from vrchain.ledger.records.encoding import digest, encode
from vrchain.ledger.records.fields import check_length

DATABASE_NAME = "ledger.sqlite"  # its presence makes a folder a ledger
SIGNATURE_BYTES = 64
PUBLIC_KEY_BYTES = 32


@dataclass(frozen=True)
class PublicKey:
    """A member's public key, 32 raw bytes; ``insecure`` when anyone can derive the private one."""

    raw: bytes
    insecure: bool = False

    def __post_init__(self) -> None:
        check_length("public key", self.raw, PUBLIC_KEY_BYTES)

    def accepts(self, data: bytes, signature: bytes) -> bool:
        """Whether ``signature`` is this key's Ed25519 signature (RFC 8032) of ``data``."""
        try:
            self._key.verify(signature, data)
        except (InvalidSignature, ValueError):
            return False
        return True

    @cached_property
    def _key(self) -> Ed25519PublicKey:
        return Ed25519PublicKey.from_public_bytes(self.raw)


@dataclass(frozen=True, repr=False)
class SigningKey:
    """A private key with its public half. It has no repr, so that no log shows it."""

    private: Ed25519PrivateKey
    public: PublicKey

    def sign(self, data: bytes) -> bytes:
        """The Ed25519 signature of ``data``, 64 bytes, the same for the same data."""
        return self.private.sign(data)


def simulated_key(seed: int, name: str) -> SigningKey:
    """The key of robot ``name`` in a simulation with ``seed``. Public knowledge: insecure."""
    secret = digest(encode("vrchain/1/simulated-key", str(int(seed)), name))
    return _signing_key(Ed25519PrivateKey.from_private_bytes(secret), insecure=True)


def random_key() -> SigningKey:
    """A new live key from the system's randomness."""
    return _signing_key(Ed25519PrivateKey.generate(), insecure=False)


def save_key(key: SigningKey, path: Path) -> None:
    """Write a live key to the new file ``path`` (PEM, PKCS 8, mode 0600), durably.

    Raises KeyFileError when the file exists, lies inside a ledger's folder, cannot be
    written, or when the key is a simulated one (a file would lose its mark).
    """
    if key.public.insecure:
        raise KeyFileError("expected a live key to save, got a simulated one, which anyone knows")
    path = Path(path)
    for folder in path.resolve().parents:
        if (folder / DATABASE_NAME).exists():
            raise KeyFileError(f"keys stay outside ledgers, but {path} lies in the ledger {folder}")
    pem = key.private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise KeyFileError(f"{path} exists; keys are never overwritten: move it away") from None
    except OSError as error:
        raise KeyFileError(f"cannot write the key {path}: {error.strerror}") from None
    try:
        with os.fdopen(handle, "wb") as file:
            os.fchmod(handle, 0o600)
            file.write(pem)
            file.flush()
            os.fsync(handle)
    except BaseException as error:
        path.unlink(missing_ok=True)
        if not isinstance(error, OSError):
            raise
        raise KeyFileError(f"cannot write the key {path}: {error.strerror}") from None


def load_key(path: Path) -> SigningKey:
    """A key that ``save_key`` wrote. KeyFileError when missing, no key, or open to others."""
    path = Path(path)
    try:
        mode = path.stat().st_mode
        pem = path.read_bytes()
    except OSError as error:
        raise KeyFileError(f"cannot read the key {path}: {error.strerror}") from None
    if mode & 0o077:
        raise KeyFileError(f"expected {path} to be its owner's only; mend it: chmod 600 '{path}'")
    try:
        private = load_pem_private_key(pem, password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        private = None
    if not isinstance(private, Ed25519PrivateKey):
        raise KeyFileError(f"expected an Ed25519 private key (PEM, no password) in {path}")
    return _signing_key(private, insecure=False)


def _signing_key(private: Ed25519PrivateKey, insecure: bool) -> SigningKey:
    raw = private.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw)
    return SigningKey(private, PublicKey(raw, insecure))
