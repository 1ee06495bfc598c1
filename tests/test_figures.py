"""The figures' scripts: each draws its picture, its PDF and its table, the same every time."""

import json
import os
import re
import shutil
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure
from worlds import ROOT

from vrchain.errors import OutputError
from vrchain.experiments.reproduction.results import PROFILES, Results
from vrchain.paths import FIGURES
from vrchain.plots import scripts as drawing
from vrchain.plots.save import save_figure
from vrchain.plots.scripts import MANIFEST, FigureError, figure_names, run_figures, run_scripts
from vrchain.plots.style import COLUMN_CM, PAGE_CM, SIDEWAYS_CM

EXPECTED = [
    "barn_map", "common_landmarks", "home_vectors", "landmark_quality", "ledger",
    "ledger_size", "mission", "panorama", "planner", "precision_recall", "proposals",
    "regions", "retrieval_time", "scene_map", "table", "team_graph", "transmission",
    "update_stages", "update_time", "worst_mistakes",
]  # fmt: skip
QUICKLY_DRAWN = [
    "landmark_quality", "ledger", "ledger_size", "precision_recall", "retrieval_time", "table",
    "transmission", "update_time",
]  # fmt: skip


def test_there_is_a_script_for_each_figure() -> None:
    assert figure_names() == EXPECTED


@pytest.mark.parametrize("name", EXPECTED)
def test_a_figure_is_drawn_with_its_pdf_and_its_table(
    name: str, smoke_results: Results, tmp_path: Path
) -> None:
    assert run_scripts(smoke_results, tmp_path, [name]) == [name]
    starts = {path.name: path.read_bytes()[:4] for path in tmp_path.iterdir()}
    assert set(starts) == {f"{name}.{ending}" for ending in ("csv", "pdf", "png")}
    assert (starts[f"{name}.png"], starts[f"{name}.pdf"]) == (b"\x89PNG", b"%PDF")
    page = re.search(rb"/MediaBox \[ 0 0 (\S+) (\S+) \]", (tmp_path / f"{name}.pdf").read_bytes())
    assert page is not None
    width_cm, height_cm = (round(float(points) / 72 * 2.54, 1) for points in page.groups())
    assert width_cm in (COLUMN_CM, PAGE_CM, SIDEWAYS_CM)
    assert height_cm <= 24.0
    table = pd.read_csv(tmp_path / f"{name}.csv") if name != "common_landmarks" else [1]
    assert len(table) > 0


def test_a_script_alone_runs_the_stages_that_it_needs_and_no_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As in a fresh clone, where there are no results; what cannot be run is told in a line."""
    results = Results(PROFILES["smoke"], tmp_path)
    monkeypatch.setattr(Results, "here", lambda: results)
    script = shutil.copy(FIGURES / "ledger.py", tmp_path)
    drawing.run_script(script, drawing.draw_of("ledger"))
    assert sorted(p.name for p in results.folder.iterdir()) == ["survey"]
    assert (tmp_path / "ledger.png").exists() and "wrote ledger.png" in capsys.readouterr().out
    with pytest.raises(SystemExit, match=r"^ledger.py: expected a table of survey, .*, got 'x'"):
        drawing.run_script(script, lambda results: results.table("survey", "x"))


@pytest.mark.parametrize(
    "names", [["ledger", "table"], pytest.param(QUICKLY_DRAWN, marks=pytest.mark.slow)]
)
def test_the_same_results_give_the_same_bytes(
    names: list[str], smoke_results: Results, tmp_path: Path
) -> None:
    """Drawn here, and by the scripts themselves in a process of their own."""
    run_scripts(smoke_results, tmp_path / "here", names)
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "VRCHAIN_PROFILE": "smoke",
        "VRCHAIN_BUILD": str(smoke_results.build),
    }
    (tmp_path / "alone").mkdir()
    for name in names:
        script = shutil.copy(FIGURES / f"{name}.py", tmp_path / "alone")
        told = subprocess.check_output([sys.executable, script], env=environment, text=True)
        assert told.startswith(f"wrote {name}.png")
    for path in (tmp_path / "here").iterdir():
        assert path.read_bytes() == (tmp_path / "alone" / path.name).read_bytes(), path.name


def test_a_figure_that_fails_is_named_and_the_others_are_drawn(
    smoke_results: Results, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scripts = tmp_path / "scripts"
    scripts.mkdir()
    shutil.copy(FIGURES / "ledger.py", scripts)
    (scripts / "broken.py").write_text("def draw(results):\n    raise ValueError('no\\nink')\n")
    (scripts / "empty.py").write_text("")
    with pytest.raises(FigureError, match="2 of 3 figures failed: broken, empty; see above"):
        run_scripts(smoke_results, tmp_path / "out", scripts=scripts)
    assert "broken: ValueError: no ink\nempty: KeyError: 'draw'" in capsys.readouterr().out
    assert sorted(p.stem for p in (tmp_path / "out").iterdir()) == ["ledger"] * 3


def test_figures_need_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    nothing = Results(PROFILES["smoke"], tmp_path / "build")
    with pytest.raises(FigureError, match="1 of 1 figures failed: update_time"):
        run_scripts(nothing, tmp_path / "out", ["update_time"])
    assert "run `vrchain reproduce --profile smoke --only update` first" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()


def test_a_figure_that_cannot_be_written_leaves_no_part_of_it(tmp_path: Path) -> None:
    (tmp_path / "name.csv").mkdir()  # in the way of the last of the three files
    with pytest.raises(OutputError, match=r"expected a plain file .*name\.csv"):
        save_figure(Figure(), pd.DataFrame(), tmp_path / "name")
    assert [path.name for path in tmp_path.iterdir()] == ["name.csv"]


def test_an_unknown_figure_is_named_with_those_there_are(
    smoke_results: Results, tmp_path: Path
) -> None:
    with pytest.raises(FigureError, match=r"common_landmarks, .* got 'tables'"):
        run_scripts(smoke_results, tmp_path / "out", ["table", "tables"])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("profile", ["quick", "paper"])
def test_only_figures_of_the_profile_paper_come_beside_their_scripts(
    profile: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, beside = tmp_path / "figures", tmp_path / "committed"
    folder.mkdir()
    beside.mkdir()
    (folder / "table.csv").write_text("a\n1\n")
    monkeypatch.setattr(drawing, "FIGURES", beside)
    monkeypatch.setattr(drawing, "run_scripts", lambda *words, **more: ["table"])
    told = run_figures(Results(PROFILES[profile], tmp_path), folder)
    made = json.loads((folder / MANIFEST).read_text())
    assert made["command"] == f"vrchain reproduce --profile {profile}"
    assert made["sha256"] == {"table.csv": sha256(b"a\n1\n").hexdigest()}
    kept = {path.name for path in beside.iterdir()}
    assert kept == ({"table.csv", MANIFEST} if profile == "paper" else set())
    assert ("also in" in told) == (profile == "paper")


def test_the_page_of_figures_has_a_row_for_each() -> None:
    page = (ROOT / "docs/results/figures.md").read_text(encoding="utf-8")
    rows = re.findall(
        r"^\| (\w+) \| [^|]* \| \[script\]\(([^)]*)\) \| (.*?) \|", page, re.MULTILINE
    )
    assert sorted(name for name, *_ in rows) == EXPECTED
    for name, script, drawn in rows:
        beside = f"../../figures/{name}"
        assert script == f"{beside}.py"
        assert drawn == f"[picture]({beside}.png), [data]({beside}.csv)"
    assert "](../../figures/manifest.json)" in page
