"""What is to play with, in a real JupyterLab: run, a control moved, the picture changed."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import nbformat
import pytest
from browser import CHROMIUM, opened, until
from worlds import ROOT

pytest.importorskip("jupyterlab")
pytest.importorskip("ipywidgets")
pytest.importorskip("websocket")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: apt-get install chromium"),
]

CELLS = {
    "drive": "vr.play.drive(yard(), vr.Pose(0, 0))",
    "tamper": "vr.play.tamper(ledger)",
    "threshold": "vr.play.threshold(results_with(Path('results')))",
    "replay": "vr.play.replay(driven())",
    "homing": "vr.play.homing(yard(), vr.Pose(0, 0))",
    "team": "vr.play.team(vr.load_scene(vr.SCENES / 'barn.yaml'))",
    "apart": "vr.play.apart(yard(), vr.Pose(0, 0))",
}
FIRST = """
from pathlib import Path
import vrchain as vr
from driven import driven
from ledgers import small_ledger
from test_play import results_with
from worlds import yard
ledger = Path("ledger")
small_ledger(ledger)
"""
TOKEN = "for-this-test"


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[str]:
    """The address of a JupyterLab in which a notebook with all of them lies."""
    home = tmp_path / "notebooks"
    home.mkdir()
    cells = [nbformat.v4.new_code_cell(source) for source in (FIRST, *CELLS.values())]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    notebook = nbformat.v4.new_notebook(cells=cells, metadata=kernel)
    nbformat.write(notebook, home / "play.ipynb")
    paths = (ROOT, ROOT / "tests", ROOT / "tests" / "play")
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(map(str, paths)),
        "JUPYTER_PREFER_ENV_PATH": "1",
        "JUPYTER_CONFIG_PATH": str(ROOT / "tools" / "jupyter"),
        "JUPYTER_CONFIG_DIR": str(tmp_path / "config"),
        "JUPYTER_DATA_DIR": str(tmp_path / "data"),
        "JUPYTER_RUNTIME_DIR": str(tmp_path / "runtime"),
    }
    command = [
        sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", "--port=0",
        "--expose-app-in-browser", f"--IdentityProvider.token={TOKEN}", f"--notebook-dir={home}",
    ]  # fmt: skip
    with (tmp_path / "lab.log").open("w") as log:
        server = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
        try:
            found: list[Path] = []

            def told() -> bool:
                found[:] = (tmp_path / "runtime").glob("jpserver-*.json")
                return bool(found)

            until(told)
            port = json.loads(found[0].read_text())["port"]
            yield f"http://127.0.0.1:{port}/lab/tree/play.ipynb?token={TOKEN}"
        finally:
            server.terminate()
            server.wait(30)


PANEL = "[...(window.jupyterapp?.shell?.widgets('main') ?? [])].find(w => w.content?.widgets)"
CELL = "document.querySelectorAll('.jp-Notebook .jp-CodeCell')[{number}]"
IMAGE = CELL + "?.querySelector('.jp-OutputArea-output img')?.src"


@pytest.mark.timeout(1500)
def test_a_control_is_moved_and_the_picture_changes(lab: str, tmp_path: Path) -> None:
    shots = Path(os.environ.get("VRCHAIN_SHOTS", tmp_path))
    with opened(lab, tmp_path / "browser") as tab:
        tab.wait(f"{PANEL}?.sessionContext?.session?.kernel?.connectionStatus === 'connected'")
        # all cells are to be in the page, and not only those that are looked at
        tab.run(
            f"{PANEL}.content.notebookConfig = "
            f"{{...{PANEL}.content.notebookConfig, windowingMode: 'none'}};"
            f"window.jupyterapp.shell.activateById({PANEL}.id)"
        )
        tab.errors.clear()  # those of starting are JupyterLab's own
        tab.run("void window.jupyterapp.commands.execute('notebook:run-all-cells')")
        for number in range(1, 1 + len(CELLS)):  # all, for cells that run draw the focus away
            tab.wait(IMAGE.format(number=number), 600)
        tab.wait(
            "document.querySelector('.jp-Notebook-ExecutionIndicator')?.dataset.status === 'idle'",
            600,
        )
        for number, name in enumerate(CELLS, 1):
            cell, image = CELL.format(number=number), IMAGE.format(number=number)
            tab.run(f"window.before = {image}; {cell}.scrollIntoView()")
            tab.picture(shots / f"{name}_before.png")
            if name in ("tamper", "team"):  # the first thing that can be chosen
                option = 1 if name == "tamper" else 0
                tab.run(
                    f"(() => {{ const s = {cell}.querySelector('select');"
                    f" s.options[{option}].selected = true;"
                    " s.dispatchEvent(new Event('change', {bubbles: true})); })()"
                )
            else:
                tab.run(f"{cell}.querySelector('.noUi-handle').focus()")
                tab.press("ArrowRight")
            tab.wait(f"{image} && {image} !== window.before")
            tab.run(f"{cell}.scrollIntoView()")
            tab.picture(shots / f"{name}_after.png")
            said = tab.run(f"{cell}.querySelector('.jp-OutputArea').innerText")
            assert "Error" not in said, said
        assert tab.errors == []
