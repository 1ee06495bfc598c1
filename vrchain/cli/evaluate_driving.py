"""Commands of ``vrchain evaluate`` that tell how well robots find their way."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from vrchain.cli.evaluate import (
    AllowTrainingSeeds,
    Jobs,
    Output,
    Seed,
    Spacing,
    Suburbs,
    app,
    kept_folder,
    tell,
)
from vrchain.cli.options import SUBURB, Json, Model, SpecOrSuburb


@app.command()
def homing(
    spec: SpecOrSuburb = SUBURB,
    places: Annotated[
        int, typer.Option(min=1, help="To home to, two in each suburb; 20 to report.")
    ] = 2,
    method: Annotated[
        list[str] | None,
        typer.Option(metavar="M", help="One for each, or MODULE:NAME of your own; all if none."),
    ] = None,
    seed: Seed = 3000,
    allow_training_seeds: AllowTrainingSeeds = False,
    jobs: Jobs = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Home to places from up to 5 m around by ours and by known methods, with and without compass.

    About 300 starts a place, minutes each. no_answer counts as 90 degrees; false_arrivals is the
    share of starts that it takes for home; return_ratio is over those whose straight way is free.
    Intervals: 95 %, bootstrap over suburbs. Broken off, the same command goes on.
    """
    from vrchain.experiments import homing as experiment
    from vrchain.experiments.scenes import scenes_of

    folder, rows = (
        kept_folder(output, "homing", seed, allow_training_seeds),
        method or experiment.ROWS,
    )
    found = experiment.evaluate(
        scenes_of(spec), places, rows, seed=seed, folder=folder, jobs=jobs
    )  # fmt: skip
    tell(experiment.summarise(found), as_json, experiment.as_table)


@app.command()
def navigation(
    spec: SpecOrSuburb = SUBURB,
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
        int,
        typer.Option(
            min=0, help="In each chain at least; if 0, two in every third, but not in small rooms."
        ),
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
    liars: Annotated[
        int, typer.Option(min=0, help="How many of the others publish what is not so.")
    ] = 0,
    lie: Annotated[
        str, typer.Option(help="odometry, still, elsewhere, old, photograph, twins or nothing.")
    ] = "odometry",
    no_reputation: Annotated[
        bool, typer.Option("--no-reputation", help="Every robot is believed how it moved.")
    ] = False,
    keep: Annotated[
        int, typer.Option(min=1, help="Newest panoramas of each robot that are planned by.")
    ] = 40,
    rarer: Annotated[
        float, typer.Option(metavar="F", help="Times the thresholds of the update rules.")
    ] = 1.0,
    quiet: Annotated[
        float, typer.Option(metavar="S", help="So long ago the others have stopped; 0: they go on.")
    ] = 0.0,
    season: Annotated[
        str | None, typer.Option(help="On the others' patrol, and of the goal's pictures.")
    ] = None,
    time: Annotated[
        str | None, typer.Option(help="Of day, then: noon, evening or overcast.")
    ] = None,
    goal_rise: Annotated[
        float, typer.Option(metavar="M", help="How much higher the goal was pictured from.")
    ] = 0.0,
    task: Annotated[
        str, typer.Option(help="goal; return, to where it set out; or change, of goal on the way.")
    ] = "goal",
    seed: Seed = 3000,
    allow_training_seeds: AllowTrainingSeeds = False,
    jobs: Jobs = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Send robots to goals out of their sight: with the ledger, alone, and with true landmarks.

    Minutes a mission. Intervals: 95 %, bootstrap over suburbs. Broken off, the same command goes
    on.
    """
    from vrchain.experiments.missions import success as experiment
    from vrchain.experiments.missions.drive import Conditions
    from vrchain.experiments.scenes import scenes_of
    from vrchain.navigation.settings import MissionConfig

    folder = kept_folder(output, "navigation", seed, allow_training_seeds)
    config = MissionConfig(reputation=not no_reputation)
    conditions = Conditions(
        patrol, wrong_edges, barred, liars, lie, keep=keep, rarer=rarer, quiet_s=quiet,
        season=season, time=time, goal_rise_m=goal_rise, task=task, config=config,
    )  # fmt: skip
    found = experiment.evaluate(
        scenes_of(spec), missions, robots, arms or experiment.ARMS, seed=seed, folder=folder,
        to_places=to_places, landmarks=landmarks, conditions=conditions, jobs=jobs,
    )  # fmt: skip
    tell(experiment.summarise(*found), as_json, experiment.as_text)


@app.command()
def team(
    spec: SpecOrSuburb = SUBURB,
    runs: Annotated[int, typer.Option(min=1, help="By turns in ten suburbs; 20 to report.")] = 1,
    robots: Annotated[int, typer.Option(min=2, max=20, help="Each with a goal of its own.")] = 10,
    patrol: Annotated[
        float, typer.Option(metavar="S", help="For how long all drive about before.")
    ] = 0.0,
    limit: Annotated[
        float, typer.Option(metavar="S", help="Who has not arrived then gives up.")
    ] = 1800.0,
    seed: Seed = 3000,
    allow_training_seeds: AllowTrainingSeeds = False,
    jobs: Jobs = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Send every robot of a team to a goal of its own, all at once: until when are all there?

    Ten minutes and more a run. Intervals: 95 %, bootstrap over suburbs. Broken off, the same
    command goes on with the next run.
    """
    from vrchain.experiments.missions import team_clock as experiment
    from vrchain.experiments.scenes import scenes_of

    folder = kept_folder(output, "team", seed, allow_training_seeds)
    found = experiment.evaluate(
        scenes_of(spec), runs, robots, seed=seed, folder=folder,
        patrol_s=patrol, limit_s=limit, jobs=jobs,
    )  # fmt: skip
    tell(experiment.summarise(found), as_json, experiment.as_table)


@app.command()
def goals(
    spec: SpecOrSuburb = SUBURB,
    suburbs: Suburbs = 4,
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

    folder = kept_folder(output, "goals", seed, allow_training_seeds)
    found = experiment.evaluate(scenes_of(spec), suburbs, most, seed=seed, folder=folder, jobs=jobs)
    tell(experiment.summarise(found), as_json, experiment.as_table)


@app.command()
def approaches(
    spec: SpecOrSuburb = SUBURB,
    suburbs: Suburbs = 4,
    most: Annotated[int, typer.Option("--goals", min=1, help="Of each suburb, at most.")] = 10,
    seed: Seed = 3000,
    allow_training_seeds: AllowTrainingSeeds = False,
    jobs: Jobs = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Drive a robot alone to goals that it sees from 8 to 20 m: does it arrive, and truly?

    Some seconds an approach. Intervals: 95 %, bootstrap over suburbs. Broken off, the same command
    goes on with the next suburb.
    """
    from vrchain.experiments.missions import approaches as experiment
    from vrchain.experiments.scenes import scenes_of

    folder = kept_folder(output, "approaches", seed, allow_training_seeds)
    found = experiment.evaluate(scenes_of(spec), suburbs, most, seed=seed, folder=folder, jobs=jobs)
    tell(experiment.summarise(found), as_json, experiment.as_table)


@app.command("homing-database")
def homing_database(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Pictures with their poses.")],
    pairs: Annotated[
        int, typer.Option(min=1, help="At most, unless the first home has more.")
    ] = 200,
    spacing: Spacing = (1.0, 5.0),
    method: Annotated[
        list[str] | None,
        typer.Option(metavar="M", help="One for each, or MODULE:NAME of your own; all if none."),
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
    from vrchain.panorama.databases import read_database, source_of
    from vrchain.panorama.sources import Source

    asked: dict[str, Any] = {"methods": method} if method else {}
    entries = read_database(folder)
    if model:
        entries = [replace(e, source=source_of(e, Source(model))) for e in entries]
    found = experiment.evaluate(
        entries, seed=seed, most_pairs=pairs, spacing_m=spacing,
        tilts_deg=tilt or (0.0,), compass_errors_deg=compass_error or (0.0,), **asked,
    )  # fmt: skip
    tell(experiment.summarise(found, spacing, position_error), as_json, experiment.as_table)
