"""The command ``vrchain panorama``: what a robot sees, drawn of a scene or made of a picture."""

import json
import math
from dataclasses import asdict
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from vrchain.cli.options import Folder, Model, Spec, doing, suburb_of
from vrchain.errors import ImageError, OutputError
from vrchain.files import check_output_folder, check_outside, output_folder

if TYPE_CHECKING:
    from vrchain.panorama.models import Mirror
    from vrchain.panorama.sources import Source

_SEVERAL = "panoramas.json"  # beside the folders of several panoramas: which picture each is of


class _DrawnIfNotTold(TyperGroup):
    """``vrchain panorama SPEC`` is short for ``vrchain panorama draw SPEC``."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        told = bool(args) and args[0] in (*self.commands, "--help")
        return super().parse_args(ctx, args if told else ["draw", *args])


app = typer.Typer(cls=_DrawnIfNotTold, help="What is seen all around: drawn, or imported.")


@app.command()
def draw(
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
    from vrchain.geometry import Pose
    from vrchain.panorama import MARKER, CameraRig
    from vrchain.world import load_scene
    from vrchain.world.model import check_on_map
    from vrchain.world.render import Renderer

    check_outside(output, spec)
    check_output_folder(output, MARKER)
    rig = CameraRig(views, width, height, field_of_view)
    pose = Pose(at[0], at[1], math.radians(at[2] % 360))
    suburb = suburb_of(spec)
    check_on_map(pose, suburb.extent_m if suburb else (math.inf, math.inf))
    with doing(f"building {spec}"):
        scene = load_scene(spec)
    scene.check_pose(pose)
    with output_folder(output, MARKER) as folder:
        Renderer(scene).render(pose, rig).save(folder, {"pose": asdict(pose)})
    print(f"wrote {output}: views, cylinder.png, {MARKER}")


FieldOfView = Annotated[
    float | None,
    typer.Option(metavar="DEG", help="Width of a picture, or of a fisheye's circle."),
]
Elevations = Annotated[
    tuple[float, float] | None,
    typer.Option(
        metavar="LOW HIGH", help="Degrees that the lowest and the highest row, or ring, look up."
    ),
]
Tilt = Annotated[float | None, typer.Option(metavar="DEG", help="The middle looks so far up.")]
Roll = Annotated[float | None, typer.Option(metavar="DEG", help="The right side is so far down.")]
Height = Annotated[
    float | None,
    typer.Option(metavar="M", help="Of the camera above the ground; lengths rest on it."),
]
Centre = Annotated[
    tuple[float, float] | None,
    typer.Option(metavar="X Y", help="Of a mirror, as shares of width and height; 0.5 0.5."),
]
Inner = Annotated[
    float | None, typer.Option(help="A mirror's inner radius, as a share of the height; 0.1.")
]
Outer = Annotated[float | None, typer.Option(help="Its outer radius; 0.5.")]
Offset = Annotated[float | None, typer.Option(metavar="DEG", help="By which a mirror is turned.")]
Flip = Annotated[bool, typer.Option("--flip", help="A mirror's outer radius looks highest.")]
Columns = Annotated[
    int | None, typer.Option(help="Of the cylinder; as many as the picture has, up to 4096.")
]


@app.command(name="import")
def import_(
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE", help="Pictures.")],
    output: Folder,
    model: Model = None,
    field_of_view: FieldOfView = None,
    elevations: Elevations = None,
    heading: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="Of the middle, clockwise from north; only kept."),
    ] = None,
    pitch: Tilt = None,
    roll: Roll = None,
    height: Height = None,
    centre: Centre = None,
    inner: Inner = None,
    outer: Outer = None,
    offset: Offset = None,
    flip: Flip = False,
    faces: Annotated[
        str | None, typer.Option(help="Order of a cubemap's faces, of the letters frblud.")
    ] = None,
    calibration: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="YAML", help="Of views: a kalibr camchain, or a camera_info for each; again."
        ),
    ] = None,
    bearing: Annotated[
        list[float] | None,
        typer.Option(
            metavar="DEG", help="Where each view looks, anticlockwise from ahead; again for each."
        ),
    ] = None,
    columns: Columns = None,
    like: Annotated[
        Path | None,
        typer.Option(
            metavar="PANORAMA", help="With the rig of this one, its height too, to compare them."
        ),
    ] = None,
) -> None:
    """Make panoramas of another camera's pictures: IMAGE's in DIR; of several, each in DIR/NAME.

    Six pictures of a cubemap, and all views of a ring, are one panorama.
    """
    from vrchain.panorama import MARKER, Panorama
    from vrchain.panorama.sources import import_panorama

    source = _source(
        model=model,
        field_of_view_deg=field_of_view,
        elevations_deg=elevations,
        heading_deg=heading,
        pitch_deg=pitch,
        roll_deg=roll,
        camera_height_m=height,
        mirror=_mirror(centre, inner, outer, offset, flip),
        faces=faces,
        calibration=tuple(calibration or ()),
        bearings_deg=tuple(bearing or ()),
        columns=columns,
    )
    if like and columns:
        raise ImageError("expected --columns or --like, whose columns count, not both")
    check_outside(output, *images)
    together = [images] if source.several and len(images) > 1 else [[image] for image in images]
    names = [group[0].stem for group in together]
    if len({*names, _SEVERAL}) <= len(names):
        raise OutputError(f"expected pictures of different names, got {', '.join(names)}: rename")
    marker = MARKER if len(together) == 1 else _SEVERAL
    rig = None if like is None else Panorama.load(like).rig
    most = 1.0
    with output_folder(output, marker) as folder:
        for name, group in zip(names, together, strict=True):
            with doing(f"importing {group[0]}"):
                imported = import_panorama(group, source, rig)
                own = folder if len(together) == 1 else folder / name
                own.mkdir(exist_ok=True)
                imported.panorama.save(own, imported.about)
                most = max(most, imported.upsampled)
        if len(together) > 1:
            sources = {image.stem: str(image) for image in images}
            (folder / _SEVERAL).write_text(json.dumps(sources, indent=2) + "\n")
        if lost := _strange(output) - {path.name for path in folder.iterdir()}:
            raise OutputError(
                f"{output} holds {', '.join(sorted(lost))}, which would be lost: choose another -o"
            )
    print(f"wrote {output}: " + (MARKER if len(together) == 1 else f"{len(together)} panoramas"))
    _say_upsampled(most)


def _strange(output: Path) -> set[str]:
    """The names in a folder of what is no single panorama's, which an import may replace."""
    from vrchain.panorama.panorama import MARKER, SAVED

    there = {path.name for path in output.iterdir()} if output.exists() else set[str]()
    if MARKER in there:
        there = {n for n in there if not any(fnmatch(n, own) for own in SAVED)}
    return there


@app.command()
def import_database(
    folder: Annotated[Path, typer.Argument(metavar="DATABASE", help="Its folder.")],
    output: Folder,
    model: Model = None,
    field_of_view: FieldOfView = None,
    elevations: Elevations = None,
    pitch: Tilt = None,
    roll: Roll = None,
    height: Height = None,
    centre: Centre = None,
    inner: Inner = None,
    outer: Outer = None,
    offset: Offset = None,
    flip: Flip = False,
    columns: Columns = None,
    headings: Annotated[
        str | None,
        typer.Option(
            help="How headings count: math, anticlockwise from x, or compass, clockwise from y; "
            "without, as the metadata or the way taken say."
        ),
    ] = None,
    floor: Annotated[str | None, typer.Option(help="Of a house in ZInD's layout.")] = None,
) -> None:
    """Make panoramas of an image database, with their positions: of Brains on Board, ZInD, or CSV.

    The result is a database too: each panorama whole, beside both CSV formats.
    """
    from vrchain.panorama.databases import (
        ENTRIES,
        MADE,
        height_of,
        on_floor,
        opened,
        read_database,
        write_database,
    )

    entries = on_floor(read_database(folder, headings), floor)
    check_outside(output, folder)
    check_output_folder(output, MADE)
    own = any(entry.own for entry in entries)
    source = _source(
        model=model,
        field_of_view_deg=field_of_view,
        elevations_deg=elevations,
        pitch_deg=pitch,
        roll_deg=roll,
        camera_height_m=height_of(entries) if height is None and not own else height,
        mirror=_mirror(centre, inner, outer, offset, flip),
        columns=columns,
    )
    upsampled = [1.0]
    with output_folder(output, MADE) as scratch, doing(f"importing {folder}"):
        write_database(scratch, opened(entries, source, upsampled))
    print(f"wrote {output}: {len(entries)} panoramas with their positions, {ENTRIES}, poses.csv")
    _say_upsampled(max(upsampled))


@app.command()
def export_database(
    panoramas: Annotated[
        list[Path], typer.Argument(metavar="PANORAMA", help="Folders of panoramas with positions.")
    ],
    output: Folder,
) -> None:
    """Write panoramas whose positions are known as an image database that others read.

    Brains on Board's format and a plain CSV; the panoramas themselves lie whole beside them.
    """
    from vrchain.panorama.databases import ENTRIES, MADE, entry_of, opened, write_database

    check_outside(output, *panoramas)
    check_output_folder(output, MADE)
    entries = [entry_of(own) for own in panoramas]
    with output_folder(output, MADE) as scratch:
        write_database(scratch, opened(entries))
    print(f"wrote {output}: {len(entries)} panoramas with their positions, {ENTRIES}, poses.csv")


def _source(**given: Any) -> "Source":
    """The options that were given; the rest as they are by default."""
    from vrchain.panorama.sources import Source

    return Source(**{name: value for name, value in given.items() if value is not None})


def _mirror(
    centre: tuple[float, float] | None,
    inner: float | None,
    outer: float | None,
    offset: float | None,
    flip: bool,
) -> "Mirror | None":
    from vrchain.panorama.models import Mirror

    given = {"centre": centre, "inner": inner, "outer": outer, "offset_deg": offset}
    told: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    return Mirror(**told, flip=flip) if told or flip else None


def _say_upsampled(times: float) -> None:
    if times > 1.05:
        print(f"upsampled: a pixel of the picture is up to {times:.1f} pixels wide or high here")
