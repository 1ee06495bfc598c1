"""The commands that compare what is seen and drive by it: ``landmarks``, ``navigate``."""

import json
import math
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vrchain.cli.options import Folder, Json, Spec, check_picture, doing, suburb_of, teller
from vrchain.errors import ImageError, OutputError
from vrchain.files import check_output_folder, check_outside, output_folder, write_file

if TYPE_CHECKING:
    from vrchain.landmarks.matching.common import CommonLandmark
    from vrchain.landmarks.matching.photos import FileComparison


def landmarks(
    a: Annotated[Path, typer.Argument(metavar="A", help="A photograph or a panorama's folder.")],
    b: Annotated[
        Path | None, typer.Argument(metavar="B", help="Another one; may lack with --why.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="PICTURE.png", help="Draw them.")
    ] = None,
    variant: Annotated[
        str,
        typer.Option(
            help="Of panoramas: cnn+sift, sift, or MODULE:NAME of your own; cnn, a part, is to "
            "compare with, not for use."
        ),
    ] = "cnn+sift",
    model: Annotated[
        str | None,
        typer.Option(
            help="Of pictures: photograph, or a panorama's: equirectangular, cylinder, mirror or "
            "fisheye; asked for where one is twice as wide as high."
        ),
    ] = None,
    why: Annotated[
        bool, typer.Option("--why", help="Tell what each stage found, and why no more.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Find what two photographs or panoramas have in common.

    Of panoramas also: in which direction B is seen from A, how it is turned, and how far it and the
    landmarks are, where that can be told.
    """
    from vrchain.landmarks.matching.photos import landmarks_of_files
    from vrchain.landmarks.matching.variants import variant_named

    if why:
        if output is not None or variant != "cnn+sift":
            raise OutputError(
                "--why draws nothing and tells of cnn+sift: leave out -o and --variant"
            )
        _why(a, b, model, as_json)
        return
    if b is None:
        raise ImageError("expected two pictures to compare; --why tells of one what it shows")
    if output is not None:
        check_picture(output)
        if output.resolve() in {
            own.resolve() for given in (a, b) for own in (given, *given.glob("*"))
        }:
            raise OutputError(f"{output} is one of the pictures to compare: choose another -o")
    with doing(f"comparing {a} and {b}"):
        found = landmarks_of_files(a, b, variant, model)
    if found.rig and variant_named(variant).partial:
        print(f"vrchain: {variant} is a part, to compare with and not for use", file=sys.stderr)
    if output is not None:
        from vrchain.plots.pictures import common_landmarks_figure
        from vrchain.plots.save import png_bytes

        names = a.name, b.name
        figure = common_landmarks_figure(found.a_rgb, found.b_rgb, found.claims, found.rig, names)
        write_file(output, png_bytes(figure))
    if as_json:
        claims = [_told(found, claim) for claim in found.claims]
        print(json.dumps({"common_landmarks": claims, "relative_pose": _pose(found)}))
        return
    print(f"{len(found.claims)} common landmarks" + (f", drawn in {output}" if output else ""))
    if pose := _pose(found):
        direction, heading = (
            f"{math.degrees(pose[k]):.0f}" for k in ("direction_rad", "heading_rad")
        )
        away = "?" if pose["distance_m"] is None else f"{pose['distance_m']:.1f}"
        print(f"B from A: {away} m away at {direction} degrees, turned by {heading} degrees")
    for number, claim in enumerate(found.claims, 1):
        told = _told(found, claim)
        regions = ", ".join(
            f"{side.upper()} view {r['view']} box {tuple(round(v) for v in r['box_px'])}"
            + ("" if r["range_m"] is None else f" {r['range_m']:.1f} m away")
            for side, r in (("a", told["a"]), ("b", told["b"]))
        )
        print(f"{number}: score {claim.score:.2f}, {claim.matches} matches, {regions}")


def _why(a: Path, b: Path | None, model: str | None, as_json: bool) -> None:
    from vrchain.landmarks.matching.why import seen_in, why_files

    with doing(f"looking at {a}" if b is None else f"comparing {a} and {b}"):
        told = list(seen_in(a, model) if b is None else why_files(a, b, model))
    if as_json:
        print(json.dumps({"stages": told}))
        return
    for stage, found in told:
        print(f"{stage}: {found}")


def _told(found: "FileComparison", claim: "CommonLandmark") -> dict[str, Any]:
    ranges_m = found.comparison.ranges_m(claim, found.rig) if found.rig else None
    sides = zip("ab", (claim.a, claim.b), ranges_m or (None, None), strict=True)
    return {"score": round(claim.score, 4)} | {
        side: asdict(region) | {"range_m": range_m} for side, region, range_m in sides
    }


def _pose(found: "FileComparison") -> dict[str, Any] | None:
    """Where B is, as A sees it; None where that is not known, or not to be relied on."""
    pose = found.comparison.relative_pose
    if pose is None or found.rig is None:
        return None
    return {
        "direction_rad": pose.direction_rad,
        "heading_rad": pose.heading_rad,
        "distance_m": found.comparison.distance_m(found.rig),
        "chance": found.comparison.chance,
    }


def navigate(
    spec: Spec,
    output: Folder,
    robots: Annotated[int, typer.Option(min=2, max=20, help="How many robots.")] = 3,
    robot: Annotated[str, typer.Option(help="Which one drives.")] = "R1",
    goal: Annotated[
        str | None, typer.Option(metavar="NAME", help="The object to find; drawn if not given.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of everything random.")] = 0,
    as_json: Json = False,
) -> None:
    """Send a robot to a goal out of its sight, by what the others put into the ledger."""
    from vrchain.plots.missions import save_pictures
    from vrchain.plots.replay import mission_gif
    from vrchain.simulation import mission
    from vrchain.simulation.task import robot_names
    from vrchain.world import load_scene

    check_outside(output, spec)
    check_output_folder(output, mission.MARKER)
    if suburb_of(spec):  # other scenes may have robots of their own
        robot_names(robots, robot)
    with doing(f"building {spec}"):
        scene = load_scene(spec)
    with output_folder(output, mission.MARKER) as folder:
        run = mission.run_mission(
            scene,
            folder / "ledger",
            seed=seed,
            n_robots=robots,
            robot=robot,
            goal=goal,
            tell=teller(as_json),
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
