"""What travels between machines: it comes out as it went in, and any other bytes are refused."""

import pytest
from ledgers import KEYS, garbage, new_chain, next_entry

from vrchain.errors import LedgerError
from vrchain.ledger import Offer
from vrchain.ledger.errors import EncodingError, TooLargeError
from vrchain.ledger.network.message import (
    MAX_MESSAGE_BYTES,
    pack_entry,
    pack_head,
    pack_offer,
    unpack_entry,
    unpack_head,
    unpack_offer,
)
from vrchain.ledger.records.encoding import digest

BLOBS = {digest(blob): blob for blob in (b"one", b"", b"three" * 1000)}


def test_a_message_comes_out_as_it_went_in() -> None:
    chain = new_chain()
    entry = next_entry(chain)
    assert unpack_entry(pack_entry(entry, BLOBS)) == (entry, BLOBS)
    assert unpack_head(pack_head(entry.block, 7)) == (entry.block, 7)
    for landmarks in (None, b"", b"seen"):
        digests = digest(b"p"), bytes(32) if landmarks is None else digest(landmarks)
        signed = chain.draft("R1", digests[0], "view", 5, digests[1]).signed(KEYS["R1"])
        blobs = (b"p",) if landmarks is None else (b"p", landmarks)
        assert unpack_offer(pack_offer(Offer(signed, b"p", landmarks))) == (signed.record, *blobs)


def test_garbage_is_refused_by_a_kind_of_error() -> None:
    entry = next_entry(new_chain())
    good = [pack_entry(entry, BLOBS), pack_head(entry.block, 1)]
    for data in garbage(600, good):
        for unpack in (unpack_entry, unpack_offer, unpack_head):
            try:
                unpack(data)
            except LedgerError:
                continue


@pytest.mark.parametrize("unpack", [unpack_entry, unpack_offer, unpack_head])
def test_a_message_of_another_kind_is_refused(unpack: object) -> None:
    for data in (b"", b"\0", pack_head(next_entry(new_chain()).block, 1)[:-1]):
        with pytest.raises(EncodingError):
            unpack(data)  # type: ignore[operator]


def test_a_message_that_servers_would_not_take_is_not_made() -> None:
    large = bytes(MAX_MESSAGE_BYTES)
    with pytest.raises(TooLargeError, match="message of at most 8000000 bytes"):
        pack_entry(next_entry(new_chain()), {digest(large): large})
