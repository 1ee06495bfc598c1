"""The command ``vrchain bench``: how long things take, and how much a landmark's look tells."""

import json
from pathlib import Path
from typing import Annotated, Literal

import typer

from vrchain.paths import SCENES

app = typer.Typer(no_args_is_help=True, help="Measure speed and distinctiveness.")

Spec = Annotated[Path, typer.Argument(metavar="[SPEC]", help="A scene file, as in scenes/.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON object instead of text.")]
Seed = Annotated[int, typer.Option(help="Of the poses that are drawn.")]


@app.command()
def render(
    spec: Spec = SCENES / "suburb.yaml",
    positions: Annotated[int, typer.Option(help="Poses to draw at.")] = 15,
    seed: Seed = 3000,
    as_json: Json = False,
) -> None:
    """Time a panorama beside pyrender's lit pass, its rays, and the building of the scene.

    Times are in microseconds; ratio: the median over the reference's; bar: what the median should
    not exceed.
    """
    from vrchain.experiments.bench_render import bench_render

    table = bench_render(spec, positions, seed=seed)
    if as_json:
        print(json.dumps({"rows": json.loads(table.to_json(orient="records"))}))
        return
    print(table.round(2).to_string(index=False, na_rep="-"))


@app.command()
def distinct(
    spec: Spec = SCENES / "suburb.yaml",
    spacing: Annotated[
        list[float] | None, typer.Option(metavar="M", help="Metres; give one for each.")
    ] = None,
    pairs: Annotated[int, typer.Option(help="Pairs of poses at each spacing.")] = 30,
    layer: Annotated[
        Literal["middle", "last"], typer.Option(help="Of the network: whose features.")
    ] = "middle",
    seed: Seed = 3000,
    as_json: Json = False,
) -> None:
    """Tell landmarks apart by ImageNet features of their true boxes alone, beside known figures.

    right: share of the landmarks common to two poses whose nearest neighbour among all landmarks
    of the other panorama is the same object; low, high: 95 % interval.
    """
    from vrchain.experiments import distinctiveness as experiment
    from vrchain.scene import load_scene

    spacings_m = spacing or list(experiment.REFERENCE)
    experiment.check_request(spacings_m, pairs)
    scene = load_scene(spec)
    found = experiment.distinctiveness(scene, spacings_m, pairs, seed=seed, layer=layer)
    table = experiment.summarise(found, seed=seed)
    if as_json:
        print(json.dumps({"rows": json.loads(table.to_json(orient="records"))}))
        return
    print(table.round(3).to_string(index=False, na_rep="-"))
