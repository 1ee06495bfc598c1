"""Importing is cheap and has no effects: heavy libraries load where they are used."""

import json
import pkgutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import vrchain

HEAVY = {"torch", "open3d", "pyrender", "OpenGL", "matplotlib", "matplotlib.pyplot", "ipywidgets"}

# Themselves imported only when something is drawn, or a network is at work.
IMPORTED_LATE = (
    "vrchain.world.render.drawer",
    "vrchain.landmarks.extraction.exact",
    "vrchain.landmarks.extraction.network",
    "vrchain.landmarks.training.imagenet",
    "vrchain.landmarks.training.learn",
    "vrchain.landmarks.training.losses",
    "vrchain.landmarks.training.profiles",
    "vrchain.landmarks.training.spots",
)


def in_fresh_process(code: str, folder: Path) -> Any:
    """The JSON that ``code`` prints, run by a new interpreter in an empty folder."""
    root = Path(vrchain.__file__).parent.parent
    code = f"import json, sys, time\nsys.path.insert(0, {str(root)!r})\n{code}"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return json.loads(done.stdout)


def modules() -> list[str]:
    names = (m.name for m in pkgutil.walk_packages(vrchain.__path__, "vrchain."))
    return sorted(name for name in names if not name.endswith("__main__"))


def test_import_takes_under_half_a_second(tmp_path: Path) -> None:
    code = "start = time.perf_counter(); import vrchain\nprint(time.perf_counter() - start)"
    assert in_fresh_process(code, tmp_path) < 0.5


def test_import_of_the_package_loads_no_library(tmp_path: Path) -> None:
    code = (
        "before = set(sys.modules); import vrchain\n"
        "new = {m.split('.')[0] for m in set(sys.modules) - before}\n"
        "print(json.dumps(sorted(new - sys.stdlib_module_names)))"
    )
    assert in_fresh_process(code, tmp_path) == ["vrchain"]


def test_no_module_loads_a_heavy_library_or_leaves_a_file(tmp_path: Path) -> None:
    """Plots load matplotlib, not its global state; they are last, so that no other can rely on it.

    One process imports them all, and tells which heavy libraries each was the first to load.
    """
    plots = [name for name in modules() if name.startswith(("vrchain.plots", "vrchain.play"))]
    others = [name for name in modules() if name not in plots]
    for late in IMPORTED_LATE:
        others.remove(late)
    code = (
        "import importlib\nfound = {}\n"
        f"for module in {[*others, *plots]!r}:\n"
        f"    before = {HEAVY!r} & set(sys.modules)\n"
        "    importlib.import_module(module)\n"
        f"    found[module] = sorted({HEAVY!r} & set(sys.modules) - before)\n"
        "print(json.dumps({module: new for module, new in found.items() if new}))"
    )
    loaded = in_fresh_process(code, tmp_path)
    assert set(loaded) <= set(plots)
    assert {library for new in loaded.values() for library in new} <= {"matplotlib"}
    assert list(tmp_path.iterdir()) == []


def test_ray_casting_prints_nothing_in_a_notebook(tmp_path: Path) -> None:
    """Open3D asks IPython where it is, and would say that it found Jupyter."""
    code = (
        "import builtins\nclass ZMQInteractiveShell: pass\n"
        "builtins.get_ipython = ZMQInteractiveShell\n"
        "from vrchain.world.truth import _open3d\n_open3d(); print(0)"
    )
    assert in_fresh_process(code, tmp_path) == 0
