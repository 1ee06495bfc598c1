"""The commands that look and drive: ``panorama``, ``landmarks``, ``navigate``."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from vrchain.files import check_output_folder, output_folder, write_file

Spec = Annotated[Path, typer.Argument(metavar="SPEC", help="A scene file or Gazebo world.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object instead of text.")]
Folder = Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="Folder to write.")]


def panorama(
    spec: Spec,
    at: Annotated[
        tuple[float, float, float], typer.Option(metavar="X Y YAW_DEG", help="Metres and degrees.")
    ],
    output: Folder,
    views: Annotated[int, typer.Option(help="Cameras in the ring.")] = 8,
    width: Annotated[int, typer.Option(help="Of a view, in pixels.")] = 640,
    height: Annotated[int, typer.Option(help="Of a view, in pixels.")] = 480,
    field_of_view: Annotated[float, typer.Option(help="Width of a view, in degrees.")] = 60.0,
) -> None:
    """Draw what a robot sees all around it: its views and the joined cylinder."""
    import numpy as np

    from vrchain.geometry import Pose
    from vrchain.panorama import MARKER, CameraRig
    from vrchain.render import Renderer
    from vrchain.scene import load_scene

    check_output_folder(output, MARKER)
    rig = CameraRig(views, width, height, field_of_view)
    scene = load_scene(spec)
    pose = Pose(at[0], at[1], float(np.radians(at[2])))
    scene.check_pose(pose)
    with output_folder(output, MARKER) as folder:
        Renderer(scene).render(pose, rig).save(folder)
    print(f"wrote {output}: views, cylinder.png, {MARKER}")


def landmarks(
    a: Annotated[Path, typer.Argument(metavar="A", help="A photograph or a panorama's folder.")],
    b: Annotated[Path, typer.Argument(metavar="B", help="Another one.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="PICTURE.png", help="Draw them.")
    ] = None,
    variant: Annotated[
        str, typer.Option(help="Of panoramas: sift, cnn, cnn+sift, or MODULE:NAME of your own.")
    ] = "cnn+sift",
    as_json: Json = False,
) -> None:
    """Find what two photographs or panoramas have in common."""
    from vrchain.landmarks.photos import landmarks_of_files
    from vrchain.plots.pictures import common_landmarks_figure
    from vrchain.plots.save import png_bytes

    found = landmarks_of_files(a, b, variant)
    claims = found.claims
    if output is not None:
        figure = common_landmarks_figure(
            found.a_rgb, found.b_rgb, claims, found.rig, (a.name, b.name)
        )
        write_file(output, png_bytes(figure))
    if as_json:
        print(
            json.dumps(
                {
                    "common_landmarks": [
                        {"score": round(c.score, 4), "a": asdict(c.a), "b": asdict(c.b)}
                        for c in claims
                    ]
                }
            )
        )
        return
    print(f"{len(claims)} common landmarks" + (f", drawn in {output}" if output else ""))
    for number, claim in enumerate(claims, 1):
        regions = ", ".join(
            f"{side} view {r.view} box {tuple(round(v) for v in r.box_px)}"
            for side, r in (("A", claim.a), ("B", claim.b))
        )
        print(f"{number}: score {claim.score:.2f}, {claim.matches} matches, {regions}")


def navigate(
    spec: Spec,
    output: Folder,
    robots: Annotated[int, typer.Option(help="How many robots.")] = 3,
    robot: Annotated[str, typer.Option(help="Which one drives.")] = "R1",
    goal: Annotated[
        str | None, typer.Option(metavar="NAME", help="The object to find; drawn if not given.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of everything random.")] = 0,
    as_json: Json = False,
) -> None:
    """Send a robot to a goal out of its sight, by what the others put into the ledger."""
    from vrchain.experiments import mission
    from vrchain.navigation.terms import Decision
    from vrchain.plots.mission import save_pictures
    from vrchain.plots.replay import mission_gif
    from vrchain.scene import load_scene

    def tell(decision: Decision) -> None:
        if not as_json:
            print(f"{decision.time_s:7.1f} s  {decision.what:10} {decision.why}", flush=True)

    check_output_folder(output, mission.MARKER)
    scene = load_scene(spec)
    with output_folder(output, mission.MARKER) as folder:
        run = mission.run(
            scene, folder / "ledger", seed=seed, n_robots=robots, robot=robot, goal=goal, tell=tell
        )
        mission.save_log(run, folder)
        save_pictures(run, folder)
        (folder / "mission.gif").write_bytes(mission_gif(run))
    summary = run.summary()
    if as_json:
        print(json.dumps(summary))
        return
    end = "arrived" if run.result.arrived else f"gave up: {run.result.reason}"
    truth = "in truth it stands" if run.result.arrived else "it stood"
    print(
        f"{robot} {end}; {truth} {run.range_m:.1f} m from {run.task.goal}. "
        f"Ledger head {run.head[:16]}. See {output}"
    )
