"""Each way to tamper with a stored ledger, and who notices."""

from collections.abc import Callable
from pathlib import Path

import pytest
from ledgers import KEYS, small_ledger

from vrchain.experiments.ledger import tampering
from vrchain.experiments.ledger.tampering import who_notices
from vrchain.ledger import errors, verify


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("tampering") / "ledger"
    small_ledger(made)
    return made


NEWCOMER, WITNESS, VERIFY, KNOWING = range(4)


@pytest.mark.parametrize(
    ("tamper", "unnoticed", "words"),
    [
        (lambda f: None, {NEWCOMER, WITNESS, VERIFY, KNOWING}, ""),
        (lambda f: tampering.change_panorama(f, "R1"), set(), "block 5: .* other bytes"),
        (lambda f: tampering.remove_panorama(f, "R1"), set(), "block 5: .* is missing"),
        (lambda f: tampering.change_record(f, 2), set(), "block 2: "),
        (lambda f: tampering.sign_again(f, "R1", KEYS["R2"]), set(), "block 5: .* valid signature"),
        (lambda f: tampering.sign_again(f, "R2", KEYS["R2"]), set(), "block 5: .* valid signature"),
        (lambda f: tampering.cut_tail(f, 2), {NEWCOMER, VERIFY}, "block 2: .* cut off"),
    ],
    ids=["nothing", "changed", "removed", "record", "signed again", "all by R2", "tail"],
)
def test_who_notices(
    folder: Path, tamper: Callable[[Path], object], unnoticed: set[int], words: str
) -> None:
    found = who_notices(folder, tamper)
    assert set(found.index[found.says == "nothing: all is good"]) == unnoticed
    assert found.says.str.contains(words)[KNOWING]
    assert verify(folder).ok  # a copy was tampered with


@pytest.mark.parametrize(
    "tamper",
    [
        lambda f: tampering.change_record(f, 9),
        lambda f: tampering.change_record(f, -1),
        lambda f: tampering.cut_tail(f, 6),
        lambda f: tampering.change_panorama(f, "R9"),
        lambda f: tampering.remove_panorama(f, "R9"),
    ],
)
def test_what_is_not_there_is_not_tampered_with(
    folder: Path, tamper: Callable[[Path], object], tmp_path: Path
) -> None:
    with pytest.raises(errors.NotFoundError, match="expected"):
        tamper(folder)
    for ask in (tamper, lambda f: who_notices(f, tamper)):
        with pytest.raises((errors.NotALedgerError, errors.NotFoundError)):
            ask(tmp_path)
    assert list(tmp_path.iterdir()) == []
