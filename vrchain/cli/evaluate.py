"""The command ``vrchain evaluate``: how well robots recognise and find their way."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from vrchain.cli.options import Json
from vrchain.errors import MissionError
from vrchain.files import check_output_file
from vrchain.paths import BUILD, SCENES

if TYPE_CHECKING:
    import pandas as pd

app = typer.Typer(no_args_is_help=True, help="Measure how well it works, with intervals.")

FIRST_SEED = 2000  # those below are for training and for choosing
SUBURB = SCENES / "suburb.yaml"

_BY_DEFAULT = "scenes/suburb.yaml"  # said without the folder that it lies in
Spec = Annotated[
    Path,
    typer.Argument(
        metavar="[SPEC]",
        help="A scene file, as in scenes/, or a world.",
        show_default=_BY_DEFAULT,
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Of suburbs and poses; 2,000 or more.")]
AllowTrainingSeeds = Annotated[
    bool, typer.Option(help="Seeds below 2,000: what was learned from and chosen by.")
]
Jobs = Annotated[
    int | None,
    typer.Option(min=1, help="Processes at once; as many as there are cores, at most 4."),
]
Output = Annotated[
    Path | None, typer.Option("-o", "--output", metavar="DIR", help="Where results are kept.")
]


@app.command()
def landmarks(
    spec: Spec = SUBURB,
    pairs: Annotated[int, typer.Option(min=1, help="Pairs of poses, ten in each suburb.")] = 40,
    spacing: Annotated[
        tuple[float, float], typer.Option(metavar="MIN MAX", help="Metres between the two.")
    ] = (1.0, 20.0),
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
    from vrchain.experiments.landmarks import precision
    from vrchain.experiments.landmarks.scores import as_table, summarise
    from vrchain.experiments.scenes import scenes_of

    _check_seed(seed, allow_training_seeds)
    found = precision.evaluate(
        scenes_of(spec), pairs, spacing, [precision.row(v) for v in variant or precision.ROWS],
        seed=seed, folder=_kept(output, "landmarks"),
    )  # fmt: skip
    summary = summarise(*found)
    if as_json:
        print(json.dumps(summary))
        return
    print(as_table(summary).to_string())


@app.command()
def strangers(
    spec: Annotated[
        Path,
        typer.Argument(
            metavar="[SPEC]",
            help="A scene file: a world has no second suburb.",
            show_default=_BY_DEFAULT,
        ),
    ] = SUBURB,
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

    Intervals: 95 %, bootstrap over suburbs. Broken off, the same command goes on.
    """
    from vrchain.experiments.intervals import shown
    from vrchain.experiments.landmarks import precision
    from vrchain.experiments.scenes import scenes_of
    from vrchain.landmarks.matching.variants import DEFAULT, variant_named

    _check_seed(seed, allow_training_seeds)
    found = precision.strangers(
        scenes_of(spec), pairs, [variant_named(v) for v in variant or [DEFAULT]], seed=seed,
        folder=_kept(output, "strangers"),
    )  # fmt: skip
    table = precision.accused(found)
    if not as_json:
        claimed = [shown(dict(row), "claimed") for _, row in table.iterrows()]
        table = table.assign(claimed=claimed).drop(columns="claimed_ci")
    _print_rows(table, as_json)


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
    _print_rows(table, as_json)


@app.command()
def search(
    spec: Spec = SUBURB,
    panoramas: Annotated[int, typer.Option(min=1, help="In each suburb.")] = 500,
    goals: Annotated[int, typer.Option(min=1, help="Looked up in each suburb.")] = 20,
    by_sift: Annotated[int, typer.Option(min=0, help="Of the goals, looked up by SIFT too.")] = 2,
    suburbs: Annotated[int, typer.Option(min=1, help="How many; a world is one.")] = 1,
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

    _check_seed(seed, allow_training_seeds)
    found = experiment.evaluate(
        scenes_of(spec), suburbs, experiment.SearchConfig(panoramas, goals, by_sift), seed=seed,
        folder=_kept(output, "search"),
    )  # fmt: skip
    summary = experiment.summarise(found)
    if as_json:
        print(json.dumps(summary))
        return
    for name, figures in summary.items():
        print(name)
        for figure, value in figures.items():
            print(f"  {figure}: {_rounded(value)}")


def _rounded(value: float | list[float] | None) -> float | list[float] | str:
    if isinstance(value, list):
        return [round(v, 3) for v in value]
    return "-" if value is None else round(value, 3)


@app.command()
def homing(
    spec: Spec = SUBURB,
    places: Annotated[
        int, typer.Option(min=1, help="To home to, two in each suburb; 20 to report.")
    ] = 2,
    method: Annotated[
        list[str] | None, typer.Option(metavar="M", help="Give one for each; all if none.")
    ] = None,
    seed: Annotated[
        int, typer.Option(min=0, help="Of suburbs, places and headings; 2,000 or more.")
    ] = 3000,
    allow_training_seeds: AllowTrainingSeeds = False,
    jobs: Jobs = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Home to places from up to 5 m around by ours and by known methods, with and without compass.

    About 300 starts a place, minutes each. no_answer counts as 90 degrees; return_ratio is over the
    starts whose straight way is free. Intervals: 95 %, bootstrap over suburbs. Broken off, the same
    command goes on.
    """
    from vrchain.experiments import homing as experiment
    from vrchain.experiments.scenes import scenes_of

    _check_seed(seed, allow_training_seeds)
    found = experiment.evaluate(
        scenes_of(spec), places, method or experiment.ROWS, seed=seed,
        folder=_kept(output, "homing"), jobs=jobs,
    )  # fmt: skip
    summary = experiment.summarise(found)
    if as_json:
        print(json.dumps(summary))
        return
    print(experiment.as_table(summary).to_string())


@app.command()
def navigation(
    spec: Spec = SUBURB,
    missions: Annotated[
        int, typer.Option(min=1, help="By turns in ten suburbs; 100 to report.")
    ] = 10,
    robots: Annotated[
        int, typer.Option(min=2, max=20, help="How many, the driving one among them.")
    ] = 5,
    arms: Annotated[
        list[str] | None, typer.Option(metavar="A", help="ledger, alone, oracle; all if none.")
    ] = None,
    to_places: Annotated[bool, typer.Option(help="Goals are places, not objects.")] = False,
    landmarks: Annotated[
        int, typer.Option(min=0, help="In each chain at least; if 0, two in every third.")
    ] = 0,
    patrol: Annotated[
        float, typer.Option(metavar="S", help="For how long the others are under way before.")
    ] = 300.0,
    wrong_edges: Annotated[
        float, typer.Option(metavar="P", help="Share of the landmark graph's edges to make wrong.")
    ] = 0.0,
    barred: Annotated[
        float, typer.Option(metavar="P", help="Share of legs with an obstacle nobody knows of.")
    ] = 0.0,
    seed: Annotated[
        int, typer.Option(min=0, help="Of suburbs, missions and noise; 2,000 or more.")
    ] = 3000,
    allow_training_seeds: AllowTrainingSeeds = False,
    jobs: Jobs = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Send robots to goals out of their sight: with the ledger, alone, and with true landmarks.

    Minutes a mission. Intervals: 95 %, bootstrap over suburbs. Broken off, the same command goes
    on.
    """
    from vrchain.experiments.missions import scores
    from vrchain.experiments.missions import success as experiment
    from vrchain.experiments.scenes import scenes_of

    _check_seed(seed, allow_training_seeds)
    found = experiment.evaluate(
        scenes_of(spec), missions, robots, arms or experiment.ARMS, seed=seed,
        folder=_kept(output, "navigation"), to_places=to_places,
        landmarks=landmarks, patrol_s=patrol, wrong_edges=wrong_edges, barred=barred, jobs=jobs,
    )  # fmt: skip
    summary = scores.summarise(*found)
    if as_json:
        print(json.dumps(summary))
        return
    first = next(iter(summary.values()))
    print(f"landmarks in the shortest chain, and missions: {first['chain_lengths']}")
    print(f"rejected draws: {first['rejected_draws']}")
    print(scores.as_table(summary).T.to_string())
    print("\nroutes driven, by the trust in them, and how many led to the goal")
    print(scores.routes_table(summary).to_string(index=False, na_rep="-"))


@app.command()
def goals(
    spec: Spec = SUBURB,
    suburbs: Annotated[int, typer.Option(min=1, help="How many; a world is one.")] = 4,
    most: Annotated[int, typer.Option("--goals", min=1, help="Of each suburb, at most.")] = 14,
    seed: Seed = 3000,
    allow_training_seeds: AllowTrainingSeeds = False,
    jobs: Jobs = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Look at goals, and at all other houses, from all sides: which are taken for the goal?

    A minute or two a suburb. Intervals: 95 %, bootstrap over suburbs. Broken off, the same command
    goes on.
    """
    from vrchain.experiments.missions import goals as experiment
    from vrchain.experiments.scenes import scenes_of

    _check_seed(seed, allow_training_seeds)
    folder = _kept(output, "goals")
    found = experiment.evaluate(scenes_of(spec), suburbs, most, seed=seed, folder=folder, jobs=jobs)
    summary = experiment.summarise(found)
    print(json.dumps(summary) if as_json else experiment.as_table(summary).to_string())


def _print_rows(table: "pd.DataFrame", as_json: bool) -> None:
    if as_json:
        print(json.dumps({"rows": table.to_dict(orient="records")}))
    else:
        print(table.to_string(index=False))


def _kept(output: Path | None, name: str) -> Path:
    """The folder that results are kept in. OutputError, before any work, if none can be."""
    folder = output or BUILD / "evaluate" / name
    check_output_file(folder / "results")
    return folder


def _check_seed(seed: int, allow_training_seeds: bool) -> None:
    if seed < FIRST_SEED and not allow_training_seeds:
        raise MissionError(
            f"seeds below {FIRST_SEED} were learned from or chosen by, got {seed}: take another, "
            "or --allow-training-seeds"
        )
