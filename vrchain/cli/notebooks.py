"""Executing the notebooks, each in a process of its own, into .ipynb with output and .html."""

import os
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from tqdm.auto import tqdm

from vrchain.errors import VRChainError
from vrchain.experiments.reproduction.results import Results
from vrchain.experiments.workers import ONE_THREAD
from vrchain.paths import NOTEBOOKS

MANIFEST = "manifest.yaml"
_LIMIT_S = 900  # a cell
_AT_ONCE = 2
_TEMPLATES = Path(__file__).parent  # the folder offline/: pages that fetch nothing


class NotebookError(VRChainError):
    """A notebook could not be executed."""


def manifest(folder: Path) -> Mapping[str, Mapping[str, Any]]:
    """The notebooks of a folder in their order, by name: tier and needs, see manifest.yaml."""
    read: Mapping[str, Mapping[str, Any]] = yaml.safe_load((folder / MANIFEST).read_text())
    return read


def run_notebooks(results: Results, folder: Path) -> str:
    """The stage ``notebooks``: all of them, on the results of a profile, into a folder."""
    chosen = manifest(NOTEBOOKS)
    slow_first = sorted(chosen, key=lambda name: chosen[name]["tier"] == "quick")
    notebooks = [NOTEBOOKS / f"{name}.ipynb" for name in slow_first]
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        done = pool.map(partial(execute, folder=folder, results=results), notebooks)
        for _ in tqdm(done, total=len(notebooks), desc="notebooks", unit="", disable=None):
            pass
    return f"executed {len(notebooks)} notebooks, as .ipynb and .html"


def execute(notebook: Path, folder: Path, results: Results) -> Path:
    """Execute a notebook with this Python into ``folder``; the path of the executed one.

    NotebookError if a cell fails. The notebook finds the profile by ``Results.here``.
    """
    environment = {
        **os.environ,
        **ONE_THREAD,  # each of those at once
        "VRCHAIN_PROFILE": results.profile.name,
        "VRCHAIN_BUILD": str(results.build.absolute()),
        "JUPYTER_PREFER_ENV_PATH": "1",  # the kernel of this Python, not of the user's home
    }
    environment.setdefault("PYOPENGL_PLATFORM", "egl")
    into = ["--output-dir", str(folder)]
    limit = f"--ExecutePreprocessor.timeout={_LIMIT_S}"
    _convert([notebook, "--to", "notebook", "--execute", limit, *into], notebook, environment)
    executed = folder / notebook.name
    template = ["--template=offline", f"--TemplateExporter.extra_template_basedirs={_TEMPLATES}"]
    _convert([executed, "--to", "html", *template, *into], notebook, environment)
    page = executed.with_suffix(".html")
    page.write_text(linked(page.read_text(encoding="utf-8"), folder), encoding="utf-8")
    return executed


def linked(page: str, folder: Path) -> str:
    """A page in ``folder`` whose links lead on from there.

    Links to a notebook lead to its page, those to other files of the project to where these are.
    What is not there, as the documents beside an installed wheel, is no link.
    """

    def there(link: re.Match[str]) -> str:
        path, mark, anchor = link[1].partition("#")
        target = (NOTEBOOKS / path).resolve()
        if not target.exists():
            return "<a>"
        if target.parent == NOTEBOOKS.resolve() and target.suffix == ".ipynb":
            return f'<a href="{target.stem}.html{mark}{anchor}">'
        return f'<a href="{os.path.relpath(target, folder.resolve())}{mark}{anchor}">'

    return re.sub(r'<a href="([^"#:][^":]*)">', there, page)


def _convert(arguments: Sequence[str | Path], notebook: Path, environment: dict[str, str]) -> None:
    command = [sys.executable, "-m", "nbconvert", "--log-level=ERROR", *map(str, arguments)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        plain = re.sub(r"\x1b\[[0-9;]*m", "", done.stderr)
        said = [line.strip() for line in plain.splitlines() if line.strip()]
        reason = said[-1] if said else f"nbconvert ended with status {done.returncode}"
        raise NotebookError(f"{notebook.name} could not be executed: {reason}")
