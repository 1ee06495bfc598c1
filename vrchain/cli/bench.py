"""The command ``vrchain bench``: how long things take."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vrchain.cli.options import SUBURB, Json, SpecOrSuburb
from vrchain.errors import LedgerError
from vrchain.paths import BUILD, SCENES

if TYPE_CHECKING:
    import pandas as pd

CLUSTER_PARTS = ("rest", "load", "flood", "kills", "bit", "hostile", "backlog", "transmission")

app = typer.Typer(no_args_is_help=True, help="Measure speed.")

Seed = Annotated[int, typer.Option(min=0, help="Of the poses that are drawn.")]


@app.command()
def render(
    spec: SpecOrSuburb = SUBURB,
    positions: Annotated[int, typer.Option(min=1, help="Poses to draw at.")] = 15,
    seed: Seed = 3000,
    as_json: Json = False,
) -> None:
    """Time a panorama beside pyrender's lit pass, its rays, and the building of the scene.

    Times are in microseconds; ratio: the median over the reference's; bar: what the median should
    not exceed.
    """
    from vrchain.experiments.rendering import bench_render

    table = bench_render(spec, positions, seed=seed)
    _tell(as_json, lambda: _text(table), rows=table)


@app.command()
def landmarks(
    spec: SpecOrSuburb = SUBURB,
    positions: Annotated[int, typer.Option(min=1, help="Panoramas, and pairs of them.")] = 15,
    seed: Seed = 3000,
    as_json: Json = False,
) -> None:
    """Time the network's proposals, a publisher's extraction and the comparison of two panoramas.

    Times are in microseconds; reference: SIFT over whole panoramas, in turns with it; ratio: the
    median over that; bar: what the median should not exceed.
    """
    from vrchain.experiments.landmarks.speed import bench_landmarks

    table = bench_landmarks(spec, positions, seed=seed)
    _tell(as_json, lambda: _text(table), rows=table)


@app.command()
def processors(
    spec: SpecOrSuburb = SUBURB,
    mission: Annotated[
        Path, typer.Option(help="A scene with a team.", show_default="scenes/barn.yaml")
    ] = SCENES / "barn.yaml",
    pairs: Annotated[int, typer.Option(help="Pairs of panoramas.")] = 2,
    seed: Seed = 3000,
    as_json: Json = False,
) -> None:
    """Where poorer processors, emulated, first compute something else than this one.

    Stage by stage: bytes, and the share of them that this processor computes too. The mission is
    driven for a minute.
    """
    from vrchain.experiments.processors import compare_processors

    table = compare_processors(spec, mission, pairs, seed=seed)
    _tell(as_json, lambda: _text(table, 6), rows=table)


@app.command()
def planner(
    tasks: Annotated[int, typer.Option(min=1, help="Chains to plan in worlds of each size.")] = 200,
    worlds: Annotated[
        int, typer.Option(min=1, help="Random worlds in which segments are lost.")
    ] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Of worlds, tasks and what is lost.")] = 3000,
    as_json: Json = False,
) -> None:
    """Time the planner beside breadth-first search and shortened chains, and drive what they plan.

    Times are in microseconds; landmarks: of a chain, the goal among them. Then, with 40 robots and
    400 landmarks, the share that arrives within so many drives when segments are lost with
    probability p, by the published rule (drive) and where what is lost stays lost (standing). Then
    one drive by the published rule, for each size of team, with 95 % intervals and the published
    shares beside: paths as published, and paths that truly end at the target. All p, and more
    columns, by --json. The modules of experiments.planning say more.
    """
    from vrchain.experiments.planning import lost_segments, published_drives
    from vrchain.experiments.planning.speed import bench_planner

    n_tasks = lost_segments.TASKS_A_WORLD
    blocked = lost_segments.shares(
        lost_segments.blocked_drives(worlds, n_tasks, seed=seed), seed=seed
    )
    drives = published_drives.one_drive(worlds, n_tasks, seed=seed)
    teams = published_drives.by_team(drives, seed=seed)
    gains = published_drives.gains(drives, seed=seed)
    table = bench_planner(tasks, seed=seed)

    def text() -> str:
        arrives, told = lost_segments.as_text(blocked), published_drives.as_text(teams, gains)
        return f"{_text(table)}\n\n{arrives}\n\n{told}"

    _tell(as_json, text, rows=table, blocked=blocked, one_drive=teams, gains=gains)


@app.command()
def cluster(
    part: Annotated[
        list[str] | None,
        typer.Option(
            help=f"{', '.join(CLUSTER_PARTS)}, or some of them; else rest, load, hostile."
        ),
    ] = None,
    updates: Annotated[int, typer.Option(min=2, help="One after another, at rest.")] = 100,
    seconds: Annotated[float, typer.Option(min=1.0, help="Of load, and of backlog.")] = 10.0,
    robots: Annotated[int, typer.Option(min=1, help="Under load.")] = 5,
    many: Annotated[int, typer.Option(min=1, help="Of backlog, a panorama in 10 s each.")] = 50,
    kills: Annotated[int, typer.Option(min=1, help="Of each server, and of the maker.")] = 2,
    seed: Annotated[int, typer.Option(min=0, help="Of payloads, keys and turns.")] = 0,
    as_json: Json = False,
) -> None:
    """Measure a ledger over three servers on this machine, and try to break it.

    rest: an update beside a bare publish and a folder's, in turns; load: robots flat out, a process
    each; flood: two robots, while a third floods; kills, bit: what is lost when things fail;
    hostile: attacks, and what stops each; backlog: many robots; transmission: bytes
    and messages on the wire as they all offer one panorama. Times are in milliseconds; the
    modules of experiments.ledger say more.
    """
    from vrchain.experiments.ledger import cluster as measured
    from vrchain.experiments.ledger import failures, flood, hostile
    from vrchain.experiments.ledger import transmission as wires

    ways: dict[str, Callable[[], pd.DataFrame]] = {
        "rest": lambda: measured.at_rest(updates, seed=seed),
        "load": lambda: measured.flat_out(seconds, robots, seed=seed),
        "flood": lambda: flood.flooded(seconds, seed=seed),
        "kills": lambda: failures.kills(kills, max(1, kills // 4), seed=seed),
        "bit": lambda: failures.flipped_bit(seed=seed),
        "hostile": lambda: hostile.attacks(seed),
        "backlog": lambda: measured.backlog(many, seconds=seconds, seed=seed),
        "transmission": lambda: wires.over_servers(
            [n for n in wires.ROBOTS if n <= many], seed=seed
        ),
    }
    parts = part or ["rest", "load", "hostile"]
    if unknown := [name for name in parts if name not in ways]:
        raise LedgerError(f"expected a --part of {', '.join(CLUSTER_PARTS)}; got {unknown[0]!r}")
    tables = {name: ways[name]() for name in parts}
    _tell(as_json, lambda: "\n\n".join(map(_text, tables.values())), **tables)


@app.command()
def ledger(
    positions: Annotated[
        list[int] | None,
        typer.Option(
            min=1, metavar="N", help="In a ledger; give one for each [40 200 500 10000 100000]."
        ),
    ] = None,
    folder: Annotated[
        Path, typer.Option(help="On the disk to measure; a new folder in it, for a while.")
    ] = BUILD,
    rounds: Annotated[int, typer.Option(min=3, help="Updates that are timed on top.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Of payloads, keys and the order of turns.")] = 0,
    as_json: Json = False,
) -> None:
    """Time updates, retrieval and verification beside what hashing, signing and the disk allow.

    reference: the limits of the same thing, measured in turns with it; ratio: the median over that;
    bar: what the ratio should not exceed. A position is one panorama of one of 10 robots; payloads
    have 200 KB up to 500 positions (a block each), 1 KB above (ten a block).
    """
    from vrchain.experiments.ledger import speed as experiment

    asked = positions or experiment.POSITIONS
    bench = experiment.bench_ledger(asked, folder, seed=seed, rounds=rounds)
    _tell(as_json, lambda: experiment.as_text(bench), rows=bench.rows, sizes=bench.sizes)


def _tell(as_json: bool, text: Callable[[], str], **tables: "pd.DataFrame") -> None:
    """Print text, or one object, a list of rows by a table's name; what does not apply is null."""
    if as_json:
        rows = {name: json.loads(t.to_json(orient="records")) for name, t in tables.items()}
        print(json.dumps(rows))
    else:
        print(text())


def _text(table: "pd.DataFrame", decimals: int = 2) -> str:
    return table.round(decimals).to_string(index=False, na_rep="-")
