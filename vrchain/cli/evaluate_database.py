"""The command ``vrchain evaluate homing-database``."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from vrchain.cli.evaluate import Spacing, app, tell
from vrchain.cli.options import Json, Model


@app.command("homing-database")
def homing_database(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Pictures with their poses.")],
    pairs: Annotated[
        int, typer.Option(min=1, help="At most, unless the first home has more.")
    ] = 200,
    spacing: Spacing = (1.0, 5.0),
    method: Annotated[
        list[str] | None, typer.Option(metavar="M", help="Give one for each; all if none.")
    ] = None,
    model: Model = None,
    tilt: Annotated[
        list[float] | None,
        typer.Option(metavar="DEG", min=0, max=45, help="Of each picture. Give one for each; 0."),
    ] = None,
    compass_error: Annotated[
        list[float] | None,
        typer.Option(metavar="DEG", min=0, max=180, help="Deviation. Give one for each; 0."),
    ] = None,
    position_error: Annotated[
        float, typer.Option(metavar="M", min=0, help="Deviation of the database's positions.")
    ] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Of homes, tilts and compass errors.")] = 3000,
    as_json: Json = False,
) -> None:
    """Home between the pictures of a database by ours and by known methods, judged by their poses.

    DIR is in the format of Brains on Board or ZInD, or holds a CSV filename,x_m,y_m,heading_deg.
    Pairs are of one room. No answer counts as 90 degrees. return_ratio: where positions form a
    grid. Intervals: 95 %, bootstrap over homes.
    """
    from vrchain.experiments import homing_database as experiment
    from vrchain.panorama.databases import read_database

    asked: dict[str, Any] = {"methods": method} if method else {}
    entries = read_database(folder)
    if model:
        entries = [replace(e, source=replace(e.source, model=model)) for e in entries]
    found = experiment.evaluate(
        entries, seed=seed, most_pairs=pairs, spacing_m=spacing,
        tilts_deg=tilt or (0.0,), compass_errors_deg=compass_error or (0.0,), **asked,
    )  # fmt: skip
    tell(experiment.summarise(found, spacing, position_error), as_json, experiment.as_table)
