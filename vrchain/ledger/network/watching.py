"""What goes on in a ledger, over several machines or in a folder, as whoever follows it sees it."""

import time
from collections.abc import Iterator
from typing import Any, TypeAlias

from vrchain.ledger.network.outbox import refused_in, waiting_in
from vrchain.ledger.network.robot import RobotLedger
from vrchain.ledger.records.block import Entry
from vrchain.ledger.store import Ledger

_LOOK_S = 0.1
News: TypeAlias = tuple[dict[str, Any], str]  # as an object, and as a line for people


def watched(ledger: Ledger, seconds: float) -> Iterator[tuple[list[Entry], list[News]]]:
    """Again and again, for so long: the blocks that have come since, and how things stand."""
    until_s, height = time.monotonic() + seconds, ledger.head.height
    while True:
        ledger.refresh()
        entries = list(ledger.entries(height + 1))
        height = ledger.head.height
        yield entries, news_of(ledger)
        if time.monotonic() > until_s:
            return
        time.sleep(_LOOK_S)


def news_of(ledger: Ledger) -> list[News]:
    """What waits and was refused, what members say, what is wrong: as an object and as a line."""
    found: list[News] = []
    if waiting := waiting_in(ledger.folder):
        found.append(({"waiting": waiting}, f"{waiting} wait in the outbox of {ledger.folder}"))
    for robot, sequence, why in refused_in(ledger.folder):
        line = f"transaction {sequence} of {robot} was refused: {why}"
        found.append(({"refused": robot, "sequence": sequence, "why": why}, line))
    if not isinstance(ledger, RobotLedger):
        return found
    for name, (height, standing) in list(ledger.others.items()):  # threads change it
        line = f"{name} is at block {height}, {standing.waiting} in its outbox"
        if standing.refused:
            line += f", {standing.refused} refused"
        if standing.alarms:
            line += f", {standing.alarms} times a server's log was wrong"
        found.append(({"member": name, "height": height, **standing._asdict()}, line))
    wrong = [*ledger.alarms, *map(str, list(ledger.trouble.values()))]
    return [*found, *[({"trouble": line}, line) for line in wrong]]
