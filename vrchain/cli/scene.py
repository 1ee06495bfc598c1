"""The command ``vrchain scene``: what is in a scene, its map, and the scene for other programs."""

import json
from pathlib import Path
from typing import Annotated

import typer

from vrchain.cli.options import Json, Spec, Strict, check_picture, doing
from vrchain.errors import SpecError
from vrchain.files import check_output_file, write_file

app = typer.Typer(no_args_is_help=True, help="Look at a scene.")


@app.command()
def info(spec: Spec, strict: Strict = False, as_json: Json = False) -> None:
    """List a scene's objects."""
    from vrchain.world import load_scene

    with doing(f"building {spec}"):
        scene = load_scene(spec, strict=strict)
    if as_json:
        objects = [
            {
                "name": o.name,
                "kind": o.kind,
                "model": o.model,
                "landmark": o.landmark,
                "centre_m": o.bounds_m.mean(axis=0).round(3).tolist(),
                "size_m": [round(v, 3) for v in o.size_m],
            }
            for o in scene.objects
        ]
        print(json.dumps({"name": scene.name, "extent_m": scene.extent_m, "objects": objects}))
        return
    print(f"{scene.name}: {scene.extent_m[0]:g} x {scene.extent_m[1]:g} m")
    table = scene.table
    counts = table.groupby("kind").agg(count=("name", "size"), landmark=("landmark", "first"))
    print(counts.to_string())
    print(table.round(2).to_string(index=False))


@app.command(name="map")
def draw_map(
    spec: Spec,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="PICTURE.png", help="The PNG to write.")
    ],
    strict: Strict = False,
) -> None:
    """Draw a scene from above."""
    from vrchain.plots.maps import scene_map
    from vrchain.plots.save import png_bytes
    from vrchain.world import load_scene

    check_picture(output)
    with doing(f"drawing {spec}"):
        write_file(output, png_bytes(scene_map(load_scene(spec, strict=strict))))
    print(f"wrote {output}")


@app.command()
def export(
    spec: Spec,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="FILE", help="A .glb; or a .world, with models/ beside it."
        ),
    ],
    strict: Strict = False,
) -> None:
    """Write a scene as one glTF file, or a suburb of ours as a Gazebo world with its models."""
    from vrchain.world import load_scene, load_spec
    from vrchain.world.export import check_name, export_scene
    from vrchain.world.gazebo import SUFFIXES
    from vrchain.world.sdf_export import SUFFIX, export_world

    as_world = output.suffix.lower() == SUFFIX
    if not as_world:
        check_name(output)
    elif spec.suffix.lower() in SUFFIXES:
        raise SpecError(
            f"expected the scene file of a suburb to write as {SUFFIX}, got the Gazebo world "
            f"{spec}: write it as .glb instead"
        )
    check_output_file(output)
    with doing(f"exporting {spec}"):
        if as_world:
            export_world(load_spec(spec), output)
        else:
            export_scene(load_scene(spec, strict=strict), output)
    print(f"wrote {output}" + (", and its models beside it" if as_world else ""))
