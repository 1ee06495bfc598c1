"""A ledger over three servers of which some may be stopped: what comes into the chain then."""

import atexit
import time
from contextlib import ExitStack
from typing import Any

import pandas as pd
from matplotlib.axes import Axes

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.cluster import Team, team
from vrchain.extras import require
from vrchain.ledger.errors import ClusterError
from vrchain.play.controls import WIDTH_IN, Choice, Play, Shown, Slider
from vrchain.plots.style import GREEN, GREY, panels, robot_colour

_SERVERS, _START_S = 3, 60.0
_PATIENCE_S = {True: 60.0, False: 4.0}  # where enough servers run, and where too few do
_PICTURE = bytes(20_000)  # stands for a panorama


def machines(robots: int = 2, seed: int = 0) -> Play:
    """Three servers, a maker and robots, each with a folder of its own, on this computer.

    At each change so many servers are stopped, the others started, and one robot publishes. All of
    it ends with the process. ClusterError without the server's program, or the extra `cluster`.
    """
    require("nats", what="a ledger over servers", error=ClusterError)
    stack = ExitStack()
    made = stack.enter_context(team(robots, seed, _SERVERS))
    atexit.register(stack.close)  # now: it has to end before the folder is removed at exit
    ledgers = {robot: stack.enter_context(made.open(robot)) for robot in made.robots}

    def draw(stopped: int, robot: str) -> Shown:
        stopped = int(stopped)
        patience_s = _PATIENCE_S[_run(made, stopped)]
        start_s = time.monotonic()
        sent = ledgers[robot].publish(robot, made.keys[robot], _PICTURE, "view", time.time_ns())
        try:
            ledgers[robot].wait(sent, patience_s)
            for ledger in ledgers.values():
                ledger.wait_until_followed(patience_s)
            took = f"It is in every folder after **{time.monotonic() - start_s:.2f} s**."
        except LedgerError as error:
            took = f"It is **not in the chain** after {patience_s:g} s: {error}."
        rows: list[dict[str, Any]] = [
            {
                "folder of": name,
                "panoramas": sum(len([*ledger.history(r)]) for r in made.robots),
                "head": ledger.head.hash.hex()[:12],
                "waiting in its outbox": ledger.outbox.count(),
            }
            for name, ledger in ledgers.items()
        ]
        figure, axes = panels(WIDTH_IN, 2.2)
        _draw(axes, stopped, rows)
        says = f"{robot} publishes with {_SERVERS - stopped} of {_SERVERS} servers. {took}"
        return Shown(says, figure, pd.DataFrame(rows))

    return Play(
        draw,
        {
            "stopped": Slider("servers that are stopped", 0, _SERVERS, 1, 0),
            "robot": Choice("who publishes", made.robots, made.robots[0]),
        },
    )


def _run(made: Team, stopped: int) -> bool:
    """Stop so many servers and start the others; wait until these serve, if they are enough."""
    names = [node.name for node in made.cluster.nodes]
    if stopped:
        made.cluster.stop(*names[:stopped])
    running = names[stopped:]
    if running:
        made.cluster.start(*running)
    enough = 2 * len(running) > _SERVERS
    if enough:
        made.cluster.wait_ready(running, _START_S)
    return enough


def _draw(axes: Axes, stopped: int, rows: list[dict[str, Any]]) -> None:
    """Servers above, those that are stopped in grey; below each robot with its panoramas."""
    for k in range(_SERVERS):
        box = {"boxstyle": "square,pad=0.6", "fc": GREY if k < stopped else GREEN, "ec": "none"}
        text = f"server {k + 1}{': stopped' if k < stopped else ''}"
        axes.text(k, 1, text, ha="center", va="center", color="white", fontsize=11, bbox=box)
    for k, row in enumerate(rows):
        x = (k + 0.5) * _SERVERS / len(rows) - 0.5
        waiting = row["waiting in its outbox"]
        text = f"{row['folder of']}: {row['panoramas']} panoramas, {waiting} waiting"
        box = {"boxstyle": "round,pad=0.5", "fc": "white", "ec": robot_colour(k)}
        axes.text(x, 0, text, ha="center", va="center", fontsize=11, bbox=box)
    axes.set(xlim=(-0.6, _SERVERS - 0.4), ylim=(-0.6, 1.6))
    axes.set_axis_off()
