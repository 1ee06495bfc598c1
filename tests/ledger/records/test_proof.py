"""Who knows the head's hash alone can check one robot's newest transaction among a thousand."""

from dataclasses import replace
from pathlib import Path

import pytest
from ledgers import KEYS, OPERATOR_KEY, new_ledger

from vrchain.ledger import Ledger, Proof, errors, simulated_key, verify_proof


def test_one_among_a_thousand(tmp_path: Path) -> None:
    keys = {f"R{number:03}": simulated_key(0, "one for all") for number in range(1000)}
    members = {robot: key.public for robot, key in keys.items()}
    with Ledger.create(tmp_path / "ledger", members, OPERATOR_KEY) as ledger:
        published = [
            ledger.publish(robot, keys[robot], robot.encode(), "start", 1)
            for robot in ("R000", "R500", "R999")
        ]
        head, root = ledger.head.hash, ledger.head.newest_root
        proofs = [ledger.proof(transaction) for transaction in published]
    for transaction, proof in zip(published, proofs, strict=True):
        sent = proof.encode()
        assert Proof.decode(sent) == proof
        assert len(proof.path) <= 10
        assert len(sent) < 1200
        verify_proof(head, transaction, Proof.decode(sent))
        climbed = proof.climbed(transaction)
        assert len(climbed) == len(proof.path) + 1 and climbed[-1] == root


def test_what_a_proof_does_not_show(tmp_path: Path) -> None:
    with new_ledger(tmp_path / "ledger") as ledger:
        first = ledger.publish("R1", KEYS["R1"], b"first", "start", 1)
        earlier_head, earlier = ledger.head.hash, ledger.proof(first)
        second = ledger.publish("R1", KEYS["R1"], b"second", "time", 2)
        other = ledger.publish("R2", KEYS["R2"], b"other", "start", 3)
        head, proof = ledger.head.hash, ledger.proof(second)
        with pytest.raises(errors.NotFoundError, match="expected the newest"):
            ledger.proof(first)
    verify_proof(head, second, proof)
    verify_proof(earlier_head, first, earlier)
    forged = replace(second, payload_digest=bytes(32)).signed(KEYS["R1"])
    for known, transaction, shown in [
        (head, first, proof),  # no longer the newest
        (head, other, proof),  # another robot's path
        (head, forged, proof),
        (head, first, earlier),  # of another head
        (bytes(32), second, proof),
        (head, second, replace(proof, path=())),
        (head, second, replace(proof, path=proof.path * 2)),
        (head, second, replace(proof, path=((1 - proof.path[0][0], proof.path[0][1]),))),
    ]:
        with pytest.raises(errors.ProofError):
            verify_proof(known, transaction, shown)


@pytest.mark.parametrize(
    "path",
    [((2, bytes(32)),), ((0, bytes(31)),), ((0, bytes(32)),) * 65],
    ids=["side", "size", "long"],
)
def test_paths_that_are_none(path: tuple[tuple[int, bytes], ...]) -> None:
    with pytest.raises(errors.RecordError, match="proof"):
        Proof(b"", path)
