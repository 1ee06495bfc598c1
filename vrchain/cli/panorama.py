"""The command ``vrchain panorama``: what a robot sees, drawn of a scene or made of a picture."""

import json
import math
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from vrchain.cli.options import Folder, Spec, doing, suburb_of
from vrchain.errors import OutputError
from vrchain.files import check_output_folder, output_folder

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

    check_output_folder(output, MARKER)
    rig = CameraRig(views, width, height, field_of_view)
    pose = Pose(at[0], at[1], math.radians(at[2] % 360))
    suburb = suburb_of(spec)
    check_on_map(pose, suburb.extent_m if suburb else (math.inf, math.inf))
    with doing(f"building {spec}"):
        scene = load_scene(spec)
    scene.check_pose(pose)
    with output_folder(output, MARKER) as folder:
        Renderer(scene).render(pose, rig).save(folder)
    print(f"wrote {output}: views, cylinder.png, {MARKER}")


@app.command(name="import")
def import_(
    images: Annotated[list[Path], typer.Argument(metavar="IMAGE", help="Pictures.")],
    output: Folder,
    model: Annotated[str, typer.Option(help="What a pixel's place means.")] = "equirectangular",
    height: Annotated[
        float,
        typer.Option(metavar="M", help="Of the camera above the ground; lengths rest on it."),
    ] = 1.0,
) -> None:
    """Make panoramas of another camera's pictures: IMAGE's in DIR; of several, each in DIR/NAME."""
    from vrchain.panorama import MARKER
    from vrchain.panorama.sources import import_panorama

    names = [image.stem for image in images]
    if len({*names, _SEVERAL}) <= len(names):
        raise OutputError(f"expected pictures of different names, got {', '.join(names)}: rename")
    if any(image.resolve().is_relative_to(output.resolve()) for image in images):
        raise OutputError(f"a picture to import lies in {output}: choose another -o")
    marker = MARKER if len(images) == 1 else _SEVERAL
    with output_folder(output, marker) as folder:
        for image in images:
            with doing(f"importing {image}"):
                panorama = import_panorama(image, model, height)
                own = folder if len(images) == 1 else folder / image.stem
                own.mkdir(exist_ok=True)
                panorama.save(own)
        if len(images) > 1:
            sources = {image.stem: str(image) for image in images}
            (folder / _SEVERAL).write_text(json.dumps(sources, indent=2) + "\n")
    print(f"wrote {output}: " + (MARKER if len(images) == 1 else f"{len(images)} panoramas"))
