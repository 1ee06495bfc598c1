"""What servers answer, as an error of ours: to wait, to go on from elsewhere, or to mend."""

import contextlib

import pytest

from vrchain.ledger import errors
from vrchain.ledger.network.connection import Connection, Servers


@pytest.mark.parametrize(
    ("code", "number", "text", "kind", "told"),
    [
        (409, 10158, "duplicate message id is in process", errors.UnavailableError, "already"),
        (400, 10071, "wrong last sequence: 7", errors.OvertakenError, "another block"),
        (404, 10059, "stream not found", errors.ClusterError, "hold no ledger"),
        (404, 10014, "consumer not found", errors.ClusterError, "hold no ledger"),
        (500, 10023, "insufficient resources", errors.ClusterError, "are full"),
        (500, 10047, "insufficient storage resources available", errors.ClusterError, "make room"),
        (400, 10003, "bad request", errors.ClusterError, "refuse: bad request"),
        (503, 10008, "JetStream system temporarily unavailable", errors.UnavailableError, "answer"),
    ],
)
def test_answers(
    code: int, number: int, text: str, kind: type[errors.LedgerError], told: str
) -> None:
    """A message that servers are writing already is no refusal: whoever sends it waits."""
    js = pytest.importorskip("nats.js.errors")

    async def answered(client: object) -> None:
        js.APIError.from_error({"code": code, "err_code": number, "description": text})

    with contextlib.closing(Connection(Servers(("nats://127.0.0.1:1",)))) as connection:

        async def connected(within_s: float) -> object:
            return object()

        connection._connected = connected  # type: ignore[method-assign, assignment]
        with pytest.raises(kind, match=told):
            connection.run(answered)
