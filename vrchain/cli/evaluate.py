"""The command ``vrchain evaluate``: how well robots recognise and find their way."""

import json
from pathlib import Path
from typing import Annotated

import typer

from vrchain.errors import MissionError
from vrchain.paths import BUILD, SCENES

app = typer.Typer(no_args_is_help=True, help="Measure how well it works, with intervals.")

FIRST_SEED = 2000  # those below are for training and for choosing


@app.callback()
def main() -> None:
    """Measure how well it works, with intervals."""


@app.command()
def landmarks(
    spec: Annotated[
        Path, typer.Argument(metavar="[SPEC]", help="A scene file, as in scenes/.")
    ] = SCENES / "suburb.yaml",
    pairs: Annotated[int, typer.Option(help="Pairs of poses, ten in each suburb.")] = 40,
    spacing: Annotated[
        tuple[float, float], typer.Option(metavar="MIN MAX", help="Metres between the two.")
    ] = (1.0, 20.0),
    variant: Annotated[
        list[str] | None, typer.Option(metavar="V", help="Give one for each; all if none.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of suburbs and poses; 2,000 or more.")] = 3000,
    allow_training_seeds: Annotated[
        bool, typer.Option(help="Seeds below 2,000: what was learned from and chosen by.")
    ] = False,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Where results are kept.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object, not text.")] = False,
) -> None:
    """Find common landmarks of random pairs of panoramas by every variant, and judge them.

    Intervals: 95 %, bootstrap over suburbs. Broken off, the same command goes on.
    """
    from vrchain.experiments import landmark_evaluation as evaluation
    from vrchain.experiments.landmark_scores import as_table, summarise
    from vrchain.experiments.scenes import scenes_of

    if seed < FIRST_SEED and not allow_training_seeds:
        raise MissionError(
            f"seeds below {FIRST_SEED} were learned from or chosen by, got {seed}: take another, "
            "or --allow-training-seeds"
        )
    found = evaluation.evaluate(
        scenes_of(spec), pairs, spacing, [evaluation.row(v) for v in variant or evaluation.ROWS],
        seed=seed, folder=output or BUILD / "evaluate" / "landmarks",
    )  # fmt: skip
    summary = summarise(*found)
    if as_json:
        print(json.dumps(summary))
        return
    print(as_table(summary).to_string())
