"""Running the scripts in ``figures/``: each draws one figure as PNG, PDF and CSV, named alike.

A script has ``draw(results)``, which returns the figure and the table of what it shows.
"""

import json
import os
import platform
import runpy
import shutil
import subprocess
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from functools import partial
from hashlib import sha256
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from vrchain.allocator import keep_freed_memory
from vrchain.errors import VRChainError
from vrchain.experiments.reproduction.results import NotRunError, Results
from vrchain.experiments.reproduction.stages import NEEDS, reproduce
from vrchain.experiments.workers import each
from vrchain.paths import FIGURES, INSTALLED
from vrchain.plots.save import save_figure

KEPT, MANIFEST = "paper", "manifest.json"  # the profile whose figures are committed

Drawn = tuple[Figure, pd.DataFrame]
"""A figure, and the table of what it shows."""
Draw = Callable[[Results], Drawn]


class FigureError(VRChainError):
    """There is no such figure, or some could not be drawn."""


def figure_names(scripts: Path = FIGURES) -> list[str]:
    """The figures that have a script, sorted."""
    return sorted(script.stem for script in scripts.glob("*.py"))


def draw_of(name: str, scripts: Path = FIGURES) -> Draw:
    """What draws a figure. FigureError if there is no such figure."""
    check_names([name], scripts)
    draw: Draw = runpy.run_path(str(scripts / f"{name}.py"))["draw"]
    return draw


def check_names(names: Sequence[str], scripts: Path = FIGURES) -> None:
    """Raise FigureError if a figure of these has no script."""
    known = figure_names(scripts)
    for name in names:
        if name not in known:
            raise FigureError(f"expected figures of {', '.join(known)}, got {name!r}")


def run_script(script: str, draw: Draw) -> None:
    """What a script does when it is run by itself; see ``Results.here`` for the profile.

    Stages of the reproduction whose results it asks for, and that were not run, are run first.
    """
    keep_freed_memory()
    path = Path(script)
    try:
        figure, table = _drawn(draw, Results.here())
    except VRChainError as error:
        raise SystemExit(f"{path.name}: {error}") from None
    save_figure(figure, table, path.resolve().with_suffix(""))
    print(f"wrote {path.stem}.png, .pdf, .csv beside {path}")


def _drawn(draw: Draw, results: Results) -> Drawn:
    while True:
        try:
            return draw(results)
        except NotRunError as missing:
            needed = {*NEEDS.get(missing.stage, ()), missing.stage}
            reproduce(results, [stage for stage in sorted(needed) if not results.has(stage)])


def run_scripts(
    results: Results,
    folder: Path,
    names: Sequence[str] = (),
    scripts: Path = FIGURES,
    jobs: int | None = 1,
) -> list[str]:
    """Draw the named figures (all, if none is named) into a folder; their names.

    One that fails does not keep the others from being drawn. FigureError then, or if there is no
    such figure. jobs: see ``workers.each``.
    """
    check_names(names, scripts)
    chosen = list(names) or figure_names(scripts)
    drawn = each(
        partial(_draw, results, folder, scripts, chosen), range(len(chosen)), jobs, "figures"
    )
    failed = [complaint for complaint in drawn if complaint]
    if failed:
        print("\n".join(["could not draw", *failed]))
        names_only = ", ".join(line.partition(":")[0] for line in failed)
        raise FigureError(f"{len(failed)} of {len(chosen)} figures failed: {names_only}; see above")
    return chosen


def _draw(results: Results, folder: Path, scripts: Path, names: Sequence[str], number: int) -> str:
    """Draw one of the figures; what kept it from being drawn, in a line."""
    name = names[number]
    try:
        figure, table = draw_of(name, scripts)(results)
        save_figure(figure, table, folder / name)
    except Exception as error:  # a script may fail in any way; say so and go on
        return f"{name}: {type(error).__name__}: {' '.join(str(error).split())}"
    return ""


def run_figures(results: Results, folder: Path) -> str:
    """The stage ``figures``: all of them; in a checkout those of ``KEPT`` beside their scripts."""
    drawn = run_scripts(results, folder, jobs=None)
    (folder / MANIFEST).write_text(manifest(results, folder))
    beside = results.profile.name == KEPT and not INSTALLED
    if beside:
        for path in sorted(folder.iterdir()):
            shutil.copyfile(path, FIGURES / path.name)
    return f"{len(drawn)} figures" + (f", also in {FIGURES.name}/" if beside else "")


def manifest(results: Results, folder: Path) -> str:
    """By what the figures in a folder were made, and the SHA-256 of each picture and table."""
    return (
        json.dumps(
            {
                "command": f"vrchain reproduce --profile {results.profile.name}",
                "seed": results.profile.seed,
                "commit": _git("rev-parse", "--short", "HEAD"),
                "changed_since": bool(_git("status", "--porcelain", "--untracked-files=no")),
                "date": datetime.now(UTC).date().isoformat(),
                "processor": _processor(),
                "python": platform.python_version(),
                "sha256": {
                    path.name: sha256(path.read_bytes()).hexdigest()
                    for path in sorted(folder.iterdir())
                    if path.suffix in (".csv", ".png")
                },
            },
            indent=2,
        )
        + "\n"
    )


def _git(*words: str) -> str:
    """What git says of the checkout; nothing where there is none."""
    command = ["git", "-C", str(FIGURES), *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip()


def _processor() -> str:
    """Its name, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {os.cpu_count()} cores"
