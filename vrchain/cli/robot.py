"""The command ``vrchain robot``: drive one robot of a team, over ROS or simulated; play one."""

import json
import math
import time
from contextlib import ExitStack, closing
from dataclasses import asdict
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vrchain.cli.bags import Rig, Slop, robots_told
from vrchain.cli.ledger_keys import member_key
from vrchain.cli.options import Folder, Json, Spec, doing, teller
from vrchain.errors import BagError, MissionError, OutputError
from vrchain.files import check_output_folder, check_outside, output_folder

if TYPE_CHECKING:
    from vrchain.ledger import SigningKey
    from vrchain.ros.nodes import Node

_PLAYED = "played.json"

RosVersion = Annotated[
    int | None,
    typer.Option(
        min=1, max=2, envvar="ROS_VERSION", help="1 or 2; else 2 if its rclpy is there, or 1."
    ),
]

app = typer.Typer(no_args_is_help=True, help="One robot of a team: driven, or played over ROS.")


@app.command()
def run(
    ledger: Annotated[
        str, typer.Option(metavar="LEDGER", help="The team's ledger: a folder, or nats://HOST,...")
    ],
    robot: Annotated[
        str, typer.Option(metavar="NAME[=/NAMESPACE]", help="It; with --ros, and its topics.")
    ],
    ros: Annotated[bool, typer.Option("--ros", help="It is on ROS.")] = False,
    scene: Annotated[
        Path | None,
        typer.Option(metavar="SPEC", help="It is simulated here: a scene file or Gazebo world."),
    ] = None,
    ros_version: RosVersion = None,
    goal: Annotated[
        list[str] | None,
        typer.Option(
            metavar="GOAL",
            help="With --ros a picture of it, a panorama's folder, several; with --scene its name.",
        ),
    ] = None,
    goal_within: Annotated[
        float,
        typer.Option(
            metavar="M", min=1.0, help="With --ros, from how far it was pictured, at most."
        ),
    ] = 15.0,
    robots: Annotated[int, typer.Option(min=2, max=20, help="How many robots, with --scene.")] = 3,
    sent: Annotated[
        str, typer.Option(metavar="NAME", help="Which is sent to the goal, with --scene.")
    ] = "R1",
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="DIR", help="Folder for the log of who is sent, with --scene."
        ),
    ] = None,
    seconds: Annotated[
        float, typer.Option(min=1.0, help="That it patrols and publishes, without a goal.")
    ] = 60.0,
    rig: Rig = None,
    slop: Slop = 0.05,
    patience: Annotated[
        float, typer.Option(min=1.0, help="How long to wait, in s, for what it is to say.")
    ] = 20.0,
    folder: Annotated[
        Path | None, typer.Option(metavar="DIR", help="This robot's copy, for nats://.")
    ] = None,
    keys: Annotated[Path | None, typer.Option(help="Folder of its signing key.")] = None,
    simulated: Annotated[
        int | None, typer.Option(metavar="SEED", help="Sign with the key of a simulation's robot.")
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Of a patrol's headings; with --scene of everything random.")
    ] = 0,
    as_json: Json = False,
) -> None:
    """Send a live robot to a goal, or on patrol, or drive one of a simulated team.

    It publishes what it sees by the update rules.
    """
    if ros == (scene is not None):
        raise BagError("expected either --ros or --scene SPEC")
    from vrchain.ledger.network.opening import is_servers, open_ledger

    if is_servers(ledger) and folder is None:
        raise OutputError("expected --folder, for this machine's copy, with nats://, got none")
    if scene is not None:
        key = member_key(folder or Path(ledger), keys, robot, simulated)
        if output is not None:
            check_outside(output, folder or Path(ledger), keys, scene)
        _run_apart(scene, ledger, folder, robot, key, robots, sent, goal, seed, output, as_json)
        return
    from vrchain.ledger.network.robot import RobotLedger
    from vrchain.navigation.goal.recognition import goal_from
    from vrchain.navigation.mission import drive_mission
    from vrchain.navigation.perception import learned_perception
    from vrchain.navigation.settings import GOAL_RANGE_M
    from vrchain.panorama import Panorama
    from vrchain.publisher import Publication, Publisher, PublishingBody
    from vrchain.reader import REMEMBERED, index_of, published_of
    from vrchain.ros.live import LiveRobot
    from vrchain.ros.robots import load_rig

    ((name, namespace),) = robots_told([robot]).items()
    pictures = [Panorama.load(Path(picture)) for picture in goal or []]
    told, perception = load_rig(rig), learned_perception()
    key = member_key(folder or Path(ledger), keys, name, simulated)
    with open_ledger(ledger, folder, key=key, name=name) as opened:
        publisher = Publisher(name, opened, key, examine=perception.record)
        with ExitStack() as stack:
            node = stack.enter_context(closing(node_of(f"vrchain_{name}", ros_version)))
            with doing(f"listening to {namespace}"):
                live = LiveRobot(node, name, namespace, told, slop, publisher.lost_track, patience)
            stack.enter_context(closing(live))
            publisher.resume(live.observe().odometry)
            publisher.lost_track()  # nobody knows how it was moved meanwhile
            body = PublishingBody[LiveRobot, Publication](live, publisher, lambda p: p)
            summary: dict[str, Any] = {"robot": name}
            if pictures:
                published = published_of(opened, name, REMEMBERED, memory=True)
                index = index_of(opened, perception)
                shown = goal_from(pictures, share=min(1.0, goal_within / GOAL_RANGE_M[1]))
                result = drive_mission(
                    name, body, published, index, shown, perception, tell=teller(as_json)
                )
                summary |= {"arrived": result.arrived, "reason": result.reason}
            else:
                _patrol(body, seconds, seed)
        if isinstance(opened, RobotLedger):  # the robot stands
            opened.wait()
        summary |= {"published": [asdict(p) for p in body.publications]}
        summary |= {"height": opened.head.height, "head": opened.head.hash.hex()}
    if as_json:
        print(json.dumps(summary))
        return
    end = "patrolled" if not pictures else "arrived" if summary["arrived"] else "gave up"
    print(f"{name} {end}; it published {len(body.publications)} panoramas")


def node_of(name: str, version: int | None = None) -> "Node":
    """A node of ROS 1 or 2; by default of ROS 2 if its rclpy is there. BagError."""
    if version == 2 or (version is None and find_spec("rclpy") is not None):
        from vrchain.ros.ros2 import Ros2

        return Ros2(name)
    from vrchain.ros.ros1 import Ros1

    return Ros1(name)


def _run_apart(
    spec: Path,
    address: str,
    folder: Path | None,
    robot: str,
    key: "SigningKey",
    robots: int,
    sent: str,
    goals: list[str] | None,
    seed: int,
    output: Path | None,
    as_json: bool,
) -> None:
    from vrchain.ledger.network.opening import open_ledger
    from vrchain.simulation.apart import run_apart
    from vrchain.simulation.mission import MARKER, save_log
    from vrchain.world import load_scene

    if len(goals or []) > 1:
        raise MissionError(f"expected one --goal with --scene, its name, got {len(goals or [])}")
    if output is not None:
        if robot != sent:
            raise OutputError(f"expected -o with the robot that is sent, {sent}, got {robot}")
        check_output_folder(output, MARKER)
    with doing(f"building {spec}"):
        built = load_scene(spec)
    with open_ledger(address, folder, key=key, name=robot) as opened:
        body, mission = run_apart(
            built, opened, robot, key, seed=seed, n_robots=robots, sent=sent,
            goal=goals[0] if goals else None, tell=teller(as_json),
        )  # fmt: skip
        height, head = opened.head.height, opened.head.hash.hex()
    if mission is not None and output is not None:
        with output_folder(output, MARKER) as made:
            save_log(mission, made)
    published = [asdict(p) for p in body.publications]
    summary = {"robot": robot, "published": published, "height": height, "head": head}
    if mission is not None:
        summary |= {"mission": mission.summary()}
    end = "is at its place"
    if mission is not None:
        end = "arrived" if mission.result.arrived else f"gave up: {mission.result.reason}"
        end += f"; in truth it stands {mission.range_m:.1f} m from {mission.task.goal}"
    said = f"{robot} {end}; it published {len(published)} panoramas"
    print(json.dumps(summary) if as_json else said)


def _patrol(body: Any, seconds: float, seed: int) -> None:
    from vrchain.robot import Wander, wander
    from vrchain.seeding import generator

    draws, mind, until_s = generator(seed, "patrol"), Wander(), time.monotonic() + seconds
    while time.monotonic() < until_s:
        drive, mind = wander(body.watch(), draws, mind)
        body.drive(drive, 0.5)


@app.command()
def play(
    spec: Spec,
    output: Folder,
    robots: Annotated[int, typer.Option(min=2, max=20, help="How many robots.")] = 3,
    robot: Annotated[str, typer.Option(help="Which one is played.")] = "R1",
    goal: Annotated[
        str | None, typer.Option(metavar="NAME", help="The object to find; drawn if not given.")
    ] = None,
    seconds: Annotated[float, typer.Option(min=1.0, help="To play, at most.")] = 1800.0,
    ros_version: RosVersion = None,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
) -> None:
    """Play a simulated robot on ROS, its team's ledger and the goal's pictures in DIR.

    It ends when who drove it has left, and says where the robot stands.
    """
    from vrchain.navigation.perception import learned_perception
    from vrchain.panorama import CameraRig
    from vrchain.ros.playing import PlayedRobot
    from vrchain.simulation.mission import is_at, set_out
    from vrchain.simulation.team import assemble, drive_to_places, team_ledger
    from vrchain.world import load_scene

    check_outside(output, spec)
    check_output_folder(output, _PLAYED)
    perception, rig = learned_perception(), CameraRig()
    with closing(node_of(f"play_{robot}", ros_version)) as node:
        with doing(f"building {spec}"):
            scene = load_scene(spec)
        simulator, task, pictures = set_out(scene, seed, robots, robot, goal, rig)
        with output_folder(output, _PLAYED) as folder:
            with team_ledger(folder / "ledger", task.starts, seed) as ledger:
                team = assemble(simulator, ledger, seed, examine=perception.record)
                drive_to_places(simulator, team, task)
            names = [f"goal_{k}" for k in range(len(pictures))]
            for name, picture in zip(names, pictures, strict=True):
                (folder / name).mkdir()
                picture.save(folder / name)
            told = {"robot": robot, "goal": task.goal, "seed": seed, "pictures": names}
            (folder / _PLAYED).write_text(json.dumps(told, indent=2) + "\n")
        goals = " ".join(f"--goal {output / name}" for name in names)
        print(
            f"playing {robot}; drive it by: vrchain robot run --ros --robot {robot}=/{robot} "
            f"--ledger {output / 'ledger'} --simulated {seed} {goals}",
            flush=True,
        )
        until_s = time.monotonic() + seconds
        PlayedRobot(node, simulator, robot).run(
            lambda left: not left and time.monotonic() < until_s
        )
    pose = simulator.pose(robot)
    there, range_m = is_at(scene, simulator.truth, task.goal, pose, rig)
    place = f"{pose.x_m:.1f}, {pose.y_m:.1f} m, {math.degrees(pose.yaw_rad):.0f} degrees"
    print(
        f"{robot} stands at {place}, {range_m:.1f} m from {task.goal}, "
        f"{'in' if there else 'not in'} reach and sight; {simulator.collisions(robot)} collisions"
    )
