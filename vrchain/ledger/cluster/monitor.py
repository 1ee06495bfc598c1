"""What servers' monitors say, which answer whoever reaches them."""

import contextlib
import http.client
import json
import ssl
import urllib.error
import urllib.request
from typing import Any

from vrchain.ledger.cluster.config import Node


def asked(node: Node, path: str, trusts: ssl.SSLContext | None = None) -> dict[str, Any]:
    """What a server's monitor says, over TLS if it trusts some; nothing if it does not answer."""
    try:
        url = f"http{'s' if trusts else ''}://{node.host}:{node.monitor_port}/{path}"
        with urllib.request.urlopen(url, timeout=5, context=trusts) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        with contextlib.suppress(ValueError):
            return json.load(error)
    except (OSError, ValueError, http.client.HTTPException):
        pass
    return {}


def row_of(node: Node, trusts: ssl.SSLContext | None) -> dict[str, Any]:
    """What a server says of itself and of the ledger's streams."""
    told = asked(node, "jsz?streams=true", trusts)
    row: dict[str, Any] = {"server": node.name, "address": node.address, "runs": bool(told)}
    accounts = told.get("account_details") or [{}]
    for stream in accounts[0].get("stream_detail") or []:
        state, cluster = stream["state"], stream.get("cluster") or {}
        name = stream["name"]
        row |= {f"{name}_messages": state["messages"], f"{name}_last": state["last_seq"]}
        row |= {f"{name}_mb": state["bytes"] / 1e6, f"{name}_deleted": state.get("num_deleted", 0)}
        row |= {f"{name}_leads": cluster.get("leader") == node.name}
    return row
