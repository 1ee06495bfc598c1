"""Admission: what is taken in here and now, each refusal of its own kind, nobody charged for it."""

from dataclasses import replace
from unittest.mock import patch

import pytest
from ledgers import KEYS, OPERATOR_KEY, garbage

from vrchain.errors import LedgerError
from vrchain.ledger import Admission, Ledger, Limits, Transaction, errors, verify
from vrchain.ledger.records.keys import PublicKey
from vrchain.ledger.rules.limits import Bucket

SECOND = 1_000_000_000


class Clock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.now_ns = 1000 * SECOND

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture
def clock() -> Clock:
    return Clock()


def door(ledger: Ledger, clock: Clock, **limits: int | float) -> Admission:
    return Admission(ledger, clock, Limits(**limits))


def chain_of(ledger: Ledger, clock: Clock, count: int, robot: str = "R1") -> list[Transaction]:
    """The robot's next transactions, each naming the one before, for b"payload"."""
    found: list[Transaction] = []
    draft = ledger.draft_transaction(robot, b"payload", "view", clock.now_ns)
    for _ in range(count):
        found.append(draft.signed(KEYS[robot]))
        draft = replace(draft, sequence=draft.sequence + 1, previous=found[-1].id)
    return found


def test_what_is_admitted_comes_into_one_block(ledger: Ledger, clock: Clock) -> None:
    admission = door(ledger, clock, block_length=2)
    sent = [*chain_of(ledger, clock, 2, "R1"), *chain_of(ledger, clock, 1, "R2")]
    assert [admission.admit(t.record, b"payload") for t in sent] == sent
    first, rest = admission.take(), admission.take()
    assert (len(first), len(rest)) == (2, 1)
    block = ledger.append_many([*first, *rest], "R2", KEYS["R2"])
    assert (block.height, block.author) == (1, "R2")
    assert (ledger.latest("R1"), ledger.latest("R2")) == (sent[1], sent[2])
    assert admission.take() == []
    assert verify(ledger.folder).ok


def test_each_refusal_has_its_kind_and_leaves_nothing(ledger: Ledger, clock: Clock) -> None:
    admission = door(ledger, clock, blob_bytes=100, skew_ns=SECOND, burst=1)
    good = chain_of(ledger, clock, 2)
    draft = ledger.draft_transaction("R1", b"payload", "view", clock.now_ns)
    refused: list[tuple[type[errors.LedgerError], bytes, bytes, bytes | None]] = [
        (errors.InputLimitError, bytes(3000), b"payload", None),
        (errors.InputLimitError, good[0].record, bytes(101), None),
        (errors.InputLimitError, good[0].record, bytes(60), bytes(60)),
        (errors.EncodingError, b"garbage", b"payload", None),
        (errors.EncodingError, ledger.head.record, b"payload", None),
        (errors.SignatureError, draft.signed(KEYS["R2"]).record, b"payload", None),
        (errors.SequenceGapError, good[1].record, b"payload", None),
        (errors.PayloadDigestError, good[0].record, b"another", None),
        (errors.PayloadDigestError, good[0].record, b"payload", b"landmarks"),
    ]
    for kind, changes in (
        (errors.UnknownMemberError, {"robot": "R3"}),
        (errors.WrongLedgerError, {"ledger_id": bytes(32)}),
        (errors.ClockSkewError, {"timestamp_ns": clock.now_ns + SECOND + 1}),
        (errors.BrokenLinkError, {"previous": b"x" * 32}),
    ):
        changed = replace(draft, **changes).signed(KEYS["R1"])
        refused.append((kind, changed.record, b"payload", None))
    for kind, record, payload, landmarks in refused:
        with pytest.raises(errors.LedgerError) as raised:
            admission.admit(record, payload, landmarks)
        assert type(raised.value) is kind
    admission.admit(good[0].record, b"payload")  # the one token of the burst is still there
    with pytest.raises(errors.RateLimitError):
        admission.admit(good[1].record, b"payload")
    assert [offer.transaction for offer in admission.take()] == good[:1]


def test_age_is_no_fault(ledger: Ledger, clock: Clock) -> None:
    """A robot that was out of reach brings what it took meanwhile; only its own order counts."""
    admission = door(ledger, clock)
    (old,) = chain_of(ledger, clock, 1)
    clock.now_ns += 10_000_000 * SECOND
    assert admission.admit(old.record, b"payload") == old
    back = replace(old, sequence=1, timestamp_ns=old.timestamp_ns - 1, previous=old.id)
    with pytest.raises(errors.TimeOrderError, match="set its clock"):
        admission.admit(replace(back, signature=b"").signed(KEYS["R1"]).record, b"payload")


def test_a_clock_that_is_set_right_earns_from_then_on() -> None:
    """For twelve hours a robot could publish no more than its burst."""
    ahead_ns = 12 * 3600 * SECOND
    bucket = Bucket(1.0, 10, ahead_ns, 10)
    bucket.take(10)
    assert bucket.fill(0) == 0
    assert bucket.fill(5 * SECOND) == 5


def test_nobody_can_use_up_anothers_rate(ledger: Ledger, clock: Clock) -> None:
    admission = door(ledger, clock, burst=2, rate_per_s=1.0)
    forged = ledger.draft_transaction("R1", b"payload", "view", clock.now_ns).signed(KEYS["R2"])
    for _ in range(100):
        with pytest.raises(errors.SignatureError):
            admission.admit(forged.record, b"payload")
    for transaction in chain_of(ledger, clock, 2):
        admission.admit(transaction.record, b"payload")


def test_the_rate_comes_back_with_time(ledger: Ledger, clock: Clock) -> None:
    admission = door(ledger, clock, burst=2, rate_per_s=0.5)
    sent = chain_of(ledger, clock, 6)
    for transaction in sent[:2]:
        admission.admit(transaction.record, b"payload")
    with pytest.raises(errors.RateLimitError):
        admission.admit(sent[2].record, b"payload")
    clock.now_ns += 2 * SECOND
    admission.admit(sent[2].record, b"payload")
    clock.now_ns -= SECOND  # a clock that is set back earns nothing
    with pytest.raises(errors.RateLimitError):
        admission.admit(sent[3].record, b"payload")
    clock.now_ns += 55 * SECOND  # a long rest fills no more than the burst
    for transaction in sent[3:5]:
        admission.admit(transaction.record, b"payload")
    with pytest.raises(errors.RateLimitError):
        admission.admit(sent[5].record, b"payload")


def test_the_queue_is_bounded(ledger: Ledger, clock: Clock) -> None:
    sent = chain_of(ledger, clock, 3)
    for limits in ({"queue_length": 2}, {"queue_bytes": 20}):
        admission = door(ledger, clock, **limits)
        for transaction in sent[:2]:
            admission.admit(transaction.record, b"payload")
        with pytest.raises(errors.QueueFullError):
            admission.admit(sent[2].record, b"payload")
        admission.take()
        assert admission._queued_bytes == 0


def test_only_what_is_new_and_in_order_costs_a_signature(ledger: Ledger, clock: Clock) -> None:
    """Neither what is refused before, nor what is in or waits, nor appending what was admitted."""
    admission = door(ledger, clock, burst=4)
    sent = chain_of(ledger, clock, 5)
    with patch.object(PublicKey, "accepts", side_effect=PublicKey.accepts, autospec=True) as asked:
        for transaction in sent[:2]:
            admission.admit(transaction.record, b"payload")
        ledger.append_many(admission.take(), "R2", KEYS["R2"])
        for transaction in sent[2:4]:
            admission.admit(transaction.record, b"payload")
        late = replace(sent[4], timestamp_ns=clock.now_ns + 10**15).signed(KEYS["R1"])
        for record in (bytes(3000), b"garbage", late.record, sent[4].record):
            with pytest.raises(errors.LedgerError):
                admission.admit(record, b"payload")
        for transaction in sent[:4]:
            with pytest.raises(errors.DuplicateError):
                admission.admit(transaction.record, b"payload")
    assert [call.args[1] for call in asked.call_args_list] == [t.body for t in sent[:4]]


def test_a_second_transaction_with_a_number_is_equivocation(ledger: Ledger, clock: Clock) -> None:
    admission = door(ledger, clock)
    (sent,) = chain_of(ledger, clock, 1)
    admission.admit(sent.record, b"payload")
    other = replace(sent, reason="time").signed(KEYS["R1"])
    with pytest.raises(errors.EquivocationError) as raised:
        admission.admit(other.record, b"payload")
    assert (raised.value.first, raised.value.second) == (sent, other)


def test_a_robots_bytes_are_limited_too(ledger: Ledger, clock: Clock) -> None:
    admission = door(ledger, clock, burst_bytes=14, rate_bytes_per_s=7.0, burst=100)
    sent = chain_of(ledger, clock, 4)
    for transaction in sent[:2]:
        admission.admit(transaction.record, b"payload")
    with pytest.raises(errors.RateLimitError, match="7 bytes"):
        admission.admit(sent[2].record, b"payload")
    clock.now_ns += SECOND
    admission.admit(sent[2].record, b"payload")


def test_what_follows_no_more_holds_up_nobody_else(ledger: Ledger, clock: Clock) -> None:
    """R1 goes behind the door's back: only its own transactions are lost by that."""
    admission = door(ledger, clock)
    cheat, second = chain_of(ledger, clock, 2, "R1")
    (honest,) = chain_of(ledger, clock, 1, "R2")
    for transaction in (cheat, honest, second):
        admission.admit(transaction.record, b"payload")
    with Ledger.open(ledger.folder, writable=True) as other:
        other.publish("R1", KEYS["R1"], b"another", "view", clock.now_ns)
    made = admission.make_block("R2", KEYS["R2"])
    assert made.appended == [honest]
    assert [(t, type(error)) for t, error in made.refused] == [
        (cheat, errors.EquivocationError),
        (second, errors.BrokenLinkError),
    ]
    assert made.block == ledger.head
    assert ledger.latest("R2") == honest
    assert verify(ledger.folder).ok


def test_who_is_expelled_while_it_waits_holds_up_nobody_else(ledger: Ledger, clock: Clock) -> None:
    admission = door(ledger, clock)
    first, second = chain_of(ledger, clock, 2, "R1")
    (honest,) = chain_of(ledger, clock, 1, "R2")
    for transaction in (first, honest):
        admission.admit(transaction.record, b"payload")
    ledger.expel("R1", OPERATOR_KEY, 1)
    with pytest.raises(errors.ExpelledMemberError):
        admission.admit(second.record, b"payload")
    made = admission.make_block("R2", KEYS["R2"])
    assert made.appended == [honest]
    assert [type(error) for _, error in made.refused] == [errors.ExpelledMemberError]
    assert admission.make_block("R2", KEYS["R2"]) == (None, [], [])


def test_a_disk_that_fails_refuses_what_was_taken(ledger: Ledger, clock: Clock) -> None:
    admission = door(ledger, clock)
    (sent,) = chain_of(ledger, clock, 1)
    admission.admit(sent.record, b"payload")
    full = errors.StorageFullError("no room")
    with patch.object(Ledger, "append_many", side_effect=full):
        assert admission.make_block("R2", KEYS["R2"]) == (None, [], [(sent, full)])
    admission.admit(sent.record, b"payload")  # again
    assert admission.make_block("R2", KEYS["R2"]).appended == [sent]


def test_an_author_who_is_no_member_is_the_callers_fault(ledger: Ledger, clock: Clock) -> None:
    admission = door(ledger, clock)
    (sent,) = chain_of(ledger, clock, 1)
    admission.admit(sent.record, b"payload")
    with pytest.raises(errors.UnknownMemberError):
        admission.make_block("R3", KEYS["R3"])


@pytest.mark.parametrize("count", [500, pytest.param(100_000, marks=pytest.mark.slow)])
def test_garbage_raises_only_the_ledgers_own_errors(
    count: int, ledger: Ledger, clock: Clock
) -> None:
    admission = door(ledger, clock, burst=1 << 30, queue_length=1 << 30, record_bytes=1 << 20)
    (good,) = chain_of(ledger, clock, 1)
    for data in garbage(count, [good.record, ledger.genesis.record]):
        if data != good.record:  # a change may change nothing
            with pytest.raises(LedgerError):
                admission.admit(data, b"payload")
    assert admission.take() == []
