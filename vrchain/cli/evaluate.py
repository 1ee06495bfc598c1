"""The command ``vrchain evaluate``: how well robots recognise and find their way."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vrchain.cli.options import SUBURB, Json, SpecOrSuburb
from vrchain.errors import MissionError
from vrchain.files import check_output_file
from vrchain.paths import BUILD

if TYPE_CHECKING:
    import pandas as pd

app = typer.Typer(no_args_is_help=True, help="Measure how well it works, with intervals.")

FIRST_SEED = 2000  # those below are for training and for choosing

Seed = Annotated[int, typer.Option(min=0, help="Of all that is drawn; 2,000 or more.")]
AllowTrainingSeeds = Annotated[
    bool, typer.Option(help="Seeds below 2,000: what was learned from and chosen by.")
]
Suburbs = Annotated[int, typer.Option(min=1, help="How many; a world is one.")]
Jobs = Annotated[
    int | None,
    typer.Option(min=1, help="Processes at once; as many as there are cores, at most 4."),
]
Spacing = Annotated[
    tuple[float, float], typer.Option(metavar="MIN MAX", help="Metres between the two.")
]
Output = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="DIR", help="Where results are kept.")
]


@app.command()
def landmarks(
    spec: SpecOrSuburb = SUBURB,
    pairs: Annotated[int, typer.Option(min=1, help="Pairs of poses, ten in each suburb.")] = 40,
    spacing: Spacing = (1.0, 20.0),
    variant: Annotated[
        list[str] | None, typer.Option(metavar="V", help="Give one for each; all if none.")
    ] = None,
    seed: Seed = 3000,
    allow_training_seeds: AllowTrainingSeeds = False,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Find common landmarks of random pairs of panoramas by every variant, and judge them.

    Intervals: 95 %, bootstrap over suburbs. Broken off, the same command goes on.
    """
    from vrchain.experiments.landmarks import precision as experiment
    from vrchain.experiments.scenes import scenes_of

    folder = kept_folder(output, "landmarks", seed, allow_training_seeds)
    rows = [experiment.row(name) for name in variant or experiment.ROWS]
    found = experiment.evaluate(scenes_of(spec), pairs, spacing, rows, seed=seed, folder=folder)
    tell(experiment.summarise(*found), as_json, experiment.as_table)


@app.command()
def degraded(
    spec: SpecOrSuburb = SUBURB,
    pairs: Annotated[int, typer.Option(min=1, help="Pairs of poses, ten in each suburb.")] = 20,
    spacing: Spacing = (1.0, 20.0),
    variant: Annotated[
        list[str] | None, typer.Option(metavar="V", help="Give one for each; sift, the default.")
    ] = None,
    seed: Seed = 3000,
    allow_training_seeds: AllowTrainingSeeds = False,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Find common landmarks in worse pictures, at half resolution and at other heights, judged.

    Blur, noise, exposure, sunflare and JPEG are of the second panorama. Intervals: 95 %, bootstrap
    over suburbs. Broken off, the same command goes on.
    """
    from vrchain.experiments.landmarks import degraded as experiment
    from vrchain.experiments.scenes import scenes_of
    from vrchain.landmarks.matching.variants import DEFAULT, variant_named

    folder = kept_folder(output, "degraded", seed, allow_training_seeds)
    variants = [variant_named(name) for name in variant or ("sift", DEFAULT)]
    found = experiment.evaluate_ways(
        scenes_of(spec), pairs, spacing, variants, seed=seed, folder=folder
    )
    _tell_rows(found, as_json, experiment.as_text)


@app.command()
def strangers(
    spec: SpecOrSuburb = SUBURB,
    pairs: Annotated[
        int, typer.Option(min=1, help="Half within one suburb, half across two; 1000 to report.")
    ] = 40,
    variant: Annotated[
        list[str] | None, typer.Option(metavar="V", help="Give one for each; the default.")
    ] = None,
    seed: Seed = 3000,
    allow_training_seeds: AllowTrainingSeeds = False,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Compare panoramas that have nothing in common: the share with any claim, by variant.

    In suburbs only: a world has no second one. Intervals: 95 %, bootstrap over suburbs. Broken off,
    the same command goes on.
    """
    from vrchain.experiments.landmarks import strangers as experiment
    from vrchain.experiments.scenes import scenes_of
    from vrchain.landmarks.matching.variants import DEFAULT, variant_named

    folder = kept_folder(output, "strangers", seed, allow_training_seeds)
    variants = [variant_named(name) for name in variant or [DEFAULT]]
    found = experiment.strangers(scenes_of(spec), pairs, variants, seed=seed, folder=folder)
    _tell_rows(experiment.accused(found), as_json, experiment.as_text)


@app.command()
def photographs(
    folders: Annotated[
        list[Path] | None, typer.Argument(metavar="[FOLDER]...", help="Each of one place.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Count the pairs of photographs with a claim: of one place, and of two. Plain SIFT beside.

    Without a folder: print how eight settings do on rendered views.
    """
    from vrchain.experiments.landmarks.photographs import choose, compare_folders

    table = compare_folders(folders) if folders else choose()
    _tell_rows(table, as_json, lambda rows: rows.to_string(index=False))


@app.command()
def tour(
    folders: Annotated[
        list[Path], typer.Argument(metavar="TOUR [OTHER]", help="A tour, and other places.")
    ],
    variant: Annotated[
        list[str] | None, typer.Option(metavar="V", help="Give one for each; sift, the default.")
    ] = None,
    height: Annotated[
        float | None,
        typer.Option(metavar="M", help="Of all cameras; else what the tour tells."),
    ] = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Compare all panoramas of a real tour whose poses are known, and with those of other places.

    TOUR is in ZInD's layout; OTHER too, or a folder of equirectangular pictures. A pose is right
    within 10 degrees of the direction and 5 of the heading. Intervals: 95 %, bootstrap over rooms.
    Broken off, the same command goes on.
    """
    from vrchain.experiments.landmarks import tours as experiment
    from vrchain.landmarks.matching.variants import DEFAULT, variant_named

    folder = _kept_in(output, "tour")
    variants = [variant_named(name) for name in variant or ("sift", DEFAULT)]
    found = experiment.evaluate(folders, variants, folder=folder, height_m=height)
    _tell_rows(experiment.summarise(found), as_json, experiment.as_text)


@app.command()
def search(
    spec: SpecOrSuburb = SUBURB,
    panoramas: Annotated[int, typer.Option(min=1, help="In each suburb.")] = 500,
    goals: Annotated[int, typer.Option(min=1, help="Looked up in each suburb.")] = 20,
    by_sift: Annotated[int, typer.Option(min=0, help="Of the goals, looked up by SIFT too.")] = 2,
    suburbs: Suburbs = 1,
    seed: Seed = 3000,
    allow_training_seeds: AllowTrainingSeeds = False,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Ask hundreds of panoramas who sees a goal, by their records and by SIFT over all of them.

    first_right: the first answer shows the goal. nobody_right: there is no answer where none does.
    """
    from vrchain.experiments.landmarks import retrieval as experiment
    from vrchain.experiments.scenes import scenes_of

    folder = kept_folder(output, "search", seed, allow_training_seeds)
    config = experiment.SearchConfig(panoramas, goals, by_sift)
    found = experiment.evaluate(scenes_of(spec), suburbs, config, seed=seed, folder=folder)
    tell(experiment.summarise(found), as_json, experiment.as_text)


def tell(found: Any, as_json: bool, text: "Callable[[Any], str | pd.DataFrame]") -> None:
    """Print what was found as one object, or as text or a table has it."""
    if as_json:
        print(json.dumps(found))
    else:
        told = text(found)
        print(told if isinstance(told, str) else told.to_string())


def _tell_rows(rows: "pd.DataFrame", as_json: bool, text: "Callable[[pd.DataFrame], str]") -> None:
    found = {"rows": rows.to_dict(orient="records")}
    tell(found, as_json, lambda _: text(rows))


def kept_folder(output: Path | None, name: str, seed: int, allow_training_seeds: bool) -> Path:
    """Where results are kept. MissionError for a seed, OutputError where none can be kept."""
    if seed < FIRST_SEED and not allow_training_seeds:
        raise MissionError(
            f"seeds below {FIRST_SEED} were learned from or chosen by, got {seed}: take another, "
            "or --allow-training-seeds"
        )
    return _kept_in(output, name)


def _kept_in(output: Path | None, name: str) -> Path:
    folder = output or BUILD / "evaluate" / name
    check_output_file(folder / "results")
    return folder
