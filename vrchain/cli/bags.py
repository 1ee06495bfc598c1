"""The command ``vrchain bag``: what ROS robots recorded, published; a patrol of ours, recorded."""

import json
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import typer

from vrchain.cli.ledger_keys import Servers, handed_on, key_of, writable
from vrchain.cli.options import Folder, Json, Spec, doing
from vrchain.errors import BagError, VRChainError
from vrchain.files import check_output_folder, check_outside, output_folder
from vrchain.ledger.errors import UnavailableError

_EXPORTED = "patrol.json"

app = typer.Typer(no_args_is_help=True, help="Bags of ROS robots: read, published, written.")

Bags = Annotated[
    list[Path],
    typer.Argument(metavar="BAG", help="A ROS 1 bag, an MCAP or SQLite file, or a bag's folder."),
]
Robots = Annotated[
    list[str] | None,
    typer.Option(metavar="NAME=/NAMESPACE", help="A robot and its topics; give one for each."),
]
Rig = Annotated[
    Path | None, typer.Option(metavar="YAML", help="Calibration that bags or topics do not tell.")
]
Slop = Annotated[
    float, typer.Option(min=0.0, help="How far apart, in s, the pictures of one moment may be.")
]


@app.command()
def info(
    bags: Bags,
    robot: Robots = None,
    rig: Rig = None,
    slop: Slop = 0.05,
    as_json: Json = False,
) -> None:
    """What bags hold, and what would be used of it; robots are guessed if none is told."""
    from vrchain.publisher import LOOK_EVERY_M
    from vrchain.robot import UpdateRules
    from vrchain.ros.contents import contents_of, gaps_of
    from vrchain.ros.publishing import looks_of
    from vrchain.ros.robots import load_rig, robot_in, robots_in

    said: list[str] = []
    with doing("reading " + ", ".join(map(str, bags))):
        contents, told = contents_of(bags, said.append), load_rig(rig)
    topics = [
        {"topic": t.name, "type": t.type, "messages": t.count, **gaps_of(t)}
        for t in sorted(contents.topics.values(), key=lambda t: t.name)
    ]
    robots: dict[str, Any] = {}
    for name, namespace in (robots_told(robot) or robots_in(contents)).items():
        lines: list[str] = []
        try:
            found = robot_in(contents, name, namespace, told, slop, lines.append)
            looks_of(found, LOOK_EVERY_M, UpdateRules().max_age_s)
        except VRChainError as error:
            robots[name] = {"namespace": namespace, "lacks": str(error), "notes": lines}
            continue
        robots[name] = {"namespace": namespace, **found.summary(), "notes": lines}
    if as_json:
        print(json.dumps({"topics": topics, "robots": robots, "notes": said}))
        return
    for row in topics:
        rate = "  {rate_hz:.1f} Hz, longest gap {longest_gap_s:.1f} s" if "rate_hz" in row else ""
        print(f"{row['messages']:7} {row['topic']}  {row['type']}" + rate.format(**row))
    for line in said:
        print(line)
    for name, row in robots.items():
        print(f"{name}={row['namespace']}: " + (row.get("lacks") or row["text"]))
        for line in (*row.get("cameras", ()), *row["notes"]):
            print(f"    {line}")


@app.command()
def publish(
    arguments: Annotated[list[Path], typer.Argument(metavar="BAG... LEDGER")],
    robot: Robots = None,
    rig: Rig = None,
    look_every: Annotated[
        float, typer.Option(metavar="M", min=0.1, help="Way between two looks around.")
    ] = 2.5,
    slop: Slop = 0.05,
    landmarks: Annotated[bool, typer.Option(help="Extract and publish landmarks.")] = True,
    keys: Annotated[Path | None, typer.Option(help="Folder of the robots' signing keys.")] = None,
    servers: Servers = None,
    as_json: Json = False,
) -> None:
    """Publish what robots recorded, by the update rules, signed, with landmarks and way.

    Broken off, the same command goes on.
    """
    from vrchain.ros.publishing import publish_bags
    from vrchain.ros.storage import files_of

    *bags, folder = arguments
    if not bags:
        raise BagError(f"expected BAG... LEDGER, got {folder} alone: name the ledger last")
    robots = robots_told(robot)
    if not robots:
        raise BagError("expected --robot NAME=/NAMESPACE, got none: `vrchain bag info` tells some")
    if servers and len(robots) > 1:
        raise BagError(
            f"expected one --robot with --servers, got {len(robots)}: each has a copy of its own"
        )
    examine = None
    if landmarks:
        from vrchain.navigation.perception import learned_perception

        examine = learned_perception().record
    said: Counter[str] = Counter()
    started, worked = time.perf_counter(), time.process_time()
    with writable(folder, servers, keys, min(robots)) as ledger:
        if why := handed_on(ledger):  # else it would be looked for in the chain, and done again
            raise UnavailableError(f"what {folder} published before waits still: {why}")
        signing = {name: key_of(ledger, keys, name) for name in robots}
        played = publish_bags(
            bags, ledger, signing, robots, rig=rig, look_every_m=look_every, slop_s=slop,
            examine=examine, tell=lambda line: said.update([line]), now_ns=time.time_ns(),
        )  # fmt: skip
        waits, head = handed_on(ledger), ledger.head
    seconds, processor_s = time.perf_counter() - started, time.process_time() - worked
    looked = sum(p.looks - p.broken - p.earlier for p in played)
    if blind := [p.robot for p in played if p.broken and p.broken == p.looks]:
        raise BagError(f"no picture of {', '.join(blind)} could be read: {next(iter(said), '')}")
    if waits:
        said[f"the newest wait to go out, {waits}"] += 1
    if as_json:
        rows = {
            p.robot: {
                "looks": p.looks, "broken": p.broken, "earlier": p.earlier,
                "published": [vars(publication) for publication in p.publications],
            }
            for p in played
        }  # fmt: skip
        print(json.dumps({
            "robots": rows, "height": head.height, "head": head.hash.hex(),
            "seconds": round(seconds, 2), "processor_s": round(processor_s, 2),
            "panoramas": looked, "notes": list(said),
        }))  # fmt: skip
        return
    for line in said:
        print(line, file=sys.stderr)
    for p in played:
        rules = Counter(publication.rule for publication in p.publications)
        told = ", ".join(f"{n} by {rule}" for rule, n in rules.items()) or "nothing new"
        earlier = f", {p.earlier} done before" if p.earlier else ""
        print(f"{p.robot}: looked {p.looks} times{earlier}, published {told}")
    size = sum(f.stat().st_size for bag in bags for f in files_of(bag)) / 1e6
    print(
        f"{looked} panoramas of {size:.1f} MB in {seconds:.1f} s, {looked / processor_s:.2f} a "
        f"second of one processor. Ledger head {head.hash.hex()[:16]}"
    )


@app.command()
def export(
    spec: Spec,
    output: Folder,
    robots: Annotated[int, typer.Option(min=1, max=20, help="How many robots.")] = 2,
    seconds: Annotated[float, typer.Option(min=1.0, help="Simulated, that they patrol.")] = 60.0,
    form: Annotated[str, typer.Option(help="mcap, sqlite3 or ros1.")] = "mcap",
    images: Annotated[str, typer.Option(help="jpeg, png or raw.")] = "jpeg",
    look_every: Annotated[
        float, typer.Option(metavar="M", min=0.1, help="Way between two looks around.")
    ] = 2.5,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
    as_json: Json = False,
) -> None:
    """Write a simulated patrol as a ROS bag, its trajectories, and the ledger that it filled."""
    from vrchain.ros.export import export_patrol
    from vrchain.ros.storage import files_of
    from vrchain.simulation.team import team_ledger
    from vrchain.world import load_scene

    check_outside(output, spec)
    check_output_folder(output, _EXPORTED)
    with doing(f"building {spec}"):
        scene = load_scene(spec)
    names = tuple(f"R{k + 1}" for k in range(robots))
    with output_folder(output, _EXPORTED) as folder, doing("driving"):
        made = export_patrol(
            scene, folder, lambda names: team_ledger(folder / "ledger", names, seed), robots=names,
            seconds=seconds, seed=seed, form=form, images=images, look_every_m=look_every,
        )  # fmt: skip
        size = sum(file.stat().st_size for file in files_of(made.bag))
        summary = {
            "bag": made.bag.name, "bytes": size, "seconds": made.seconds, "robots": list(names),
            "published": [vars(p) for p in made.publications],
        }  # fmt: skip
        (folder / _EXPORTED).write_text(json.dumps(summary, indent=2) + "\n")
    if as_json:
        print(json.dumps(summary))
        return
    print(
        f"wrote {output}: {made.bag.name} of {size / 1e6:.1f} MB, {made.seconds:.0f} s of "
        f"{', '.join(names)}, who published {len(made.publications)} panoramas meanwhile"
    )


def robots_told(robots: list[str] | None) -> dict[str, str]:
    """Names and namespaces as options give them. BagError."""
    found: dict[str, str] = {}
    for told in robots or []:
        name, equals, namespace = told.partition("=")
        if not (name and equals and namespace.startswith("/")) or name in found:
            raise BagError(f"expected --robot NAME=/NAMESPACE, each name once, got {told!r}")
        found[name] = namespace
    return found
