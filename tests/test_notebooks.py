"""The notebooks are thin, stored without output, and each can be executed by itself."""

import ast
import re
from collections.abc import Callable
from pathlib import Path

import nbformat
import numpy as np
import pytest
from ledgers import small_ledger
from pages import fetched
from snippets import strangers
from worlds import ROOT

import vrchain as vr
from vrchain.cli import notebooks
from vrchain.cli.notebooks import MANIFEST, NotebookError, execute, linked, manifest
from vrchain.experiments.reproduction.results import PROFILES, Results
from vrchain.paths import NOTEBOOKS

TIERS = {name: about["tier"] for name, about in manifest(NOTEBOOKS).items()}
NAMES = list(TIERS)
NEEDS = {  # what a cell calls tells what its notebook needs
    "torch": ("common_landmarks(", "run_mission("),
    "results": ("reproduced(",),
}
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
LONGEST_FUNCTION = 6  # lines; what is longer belongs into the library


def read(path: Path) -> nbformat.NotebookNode:
    return nbformat.read(path, as_version=4)


def code_of(name: str) -> str:
    cells = read(NOTEBOOKS / f"{name}.ipynb").cells
    return "\n".join(cell.source for cell in cells if cell.cell_type == "code")


def python_of(source: str) -> ast.Module:
    return ast.parse("\n".join(line for line in source.splitlines() if not line.startswith("%")))


def functions(tree: ast.Module) -> list[tuple[str, int]]:
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Lambda)
    return [
        (getattr(node, "name", "lambda"), (node.end_lineno or 0) - node.lineno + 1)
        for node in ast.walk(tree)
        if isinstance(node, kinds)
    ]


def test_the_manifest_names_all_notebooks_and_what_they_need() -> None:
    """Slow ones are executed by `make reproduce` and `make test-all`."""
    assert sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb")) == NAMES
    assert set(TIERS.values()) == {"quick", "slow"}
    for name, about in manifest(NOTEBOOKS).items():
        code = code_of(name)
        assert about["needs"] == [n for n, calls in NEEDS.items() if any(c in code for c in calls)]


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_is_thin_says_what_it_is_about_and_is_stored_without_output(name: str) -> None:
    notebook = read(NOTEBOOKS / f"{name}.ipynb")
    nbformat.validate(notebook)
    assert notebook.metadata.kernelspec.name == "python3"
    assert [cell.id for cell in notebook.cells] == [
        f"{name[:2]}-{number:02d}" for number in range(1, len(notebook.cells) + 1)
    ]
    words = next(cell.source for cell in notebook.cells if cell.cell_type == "markdown")
    assert words.startswith("# ") and "**Question.**" in words and "**Idea.**" in words
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert cell.outputs == [] and cell.execution_count is None
            long = [f for f in functions(python_of(cell.source)) if f[1] > LONGEST_FUNCTION]
            assert long == []


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_can_be_changed_at_its_top_and_ends_with_an_answer_and_exercises(
    name: str,
) -> None:
    cells = read(NOTEBOOKS / f"{name}.ipynb").cells
    tagged = [k for k, cell in enumerate(cells) if "parameters" in cell.metadata.get("tags", [])]
    assert tagged == [2] and cells[2].source.startswith("# yours to change")
    last = cells[-1].source
    assert last.startswith("**Answer.**")
    assert last.count("<details><summary>Solution</summary>\n\n") == 2 == last.count("</details>")


BARN = vr.SCENES / "barn.yaml"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda: vr.load_scene(vr.SCENES / "town.yaml"), "no scene file .*town.yaml"),
        (lambda: vr.Panorama(vr.CameraRig(8, 16, 16), black()).view(9), "of 0 to 7, got 9"),
        (
            lambda: next(vr.draw_pairs(vr.load_scene(BARN), 1, (9, 4), 0)),
            "from low to high",
        ),
        (lambda: next(vr.draw_pairs(vr.load_scene(BARN), 1, (200, 300), 0)), "found only 0 of 1"),
        (lambda: vr.load_scene(BARN).check_pose(vr.Pose(4.0, 31.0)), "inside or within .* 'barn'"),
        (lambda: next(vr.draw_pairs(vr.load_scene(BARN), 1, (5, 9), "one")), "a whole number"),
        (lambda: vr.load_scene(BARN).check_pose((4.0, 1.0)), "a pose of three finite numbers"),
        (lambda: vr.reproduced("fast"), "a profile of quick, paper, got 'fast'"),
    ],
)
def test_a_value_that_cannot_be_is_answered_in_a_sentence(
    change: Callable[[], object], said: str
) -> None:
    """Those that exercises ask for, and some near to them."""
    with pytest.raises(vr.VRChainError, match=said):
        change()


def black() -> np.ndarray:
    return np.zeros((8, 16, 16, 3), dtype=np.uint8)


def test_a_block_that_is_not_there_is_named(tmp_path: Path) -> None:
    small_ledger(tmp_path / "ledger")
    with (
        vr.Ledger.open(tmp_path / "ledger") as ledger,
        pytest.raises(vr.LedgerError, match="block 9 is missing"),
    ):
        ledger.entry(9)
    with (
        vr.Ledger.open(tmp_path / "ledger") as ledger,
        pytest.raises(vr.LedgerError, match="block '2' is missing: expected a number from 0 to"),
    ):
        ledger.entry("2")


def test_with_a_fourth_robot_two_landmarks_must_go() -> None:
    """The exercise of the mission, in the barn."""
    barn = vr.load_scene(BARN)
    play = vr.play.team(barn, dict(barn.robots) | {"R4": vr.Pose(10.0, -11.0)}, "barn")
    assert "R1 - L12 - R2" in play.at().says
    assert "R1 - L14b - R4 - L34b - R3" in play.at(without="L12: shed").says
    both = play.at(without=("L12: shed", "L14b: fence 03"))
    assert "no chain leads to the goal" in both.says


@pytest.mark.parametrize("name", NAMES)
def test_a_notebook_knows_the_package_by_its_public_names_alone(name: str) -> None:
    assert strangers(python_of(code_of(name))) == []


@pytest.mark.parametrize("name", NAMES)
def test_links_of_a_notebook_lead_on_in_the_folder_and_on_its_page(
    name: str, tmp_path: Path
) -> None:
    words = [c.source for c in read(NOTEBOOKS / f"{name}.ipynb").cells if c.cell_type == "markdown"]
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", "\n".join(words))
    links = [link for link in links if "://" not in link]
    assert [link for link in links if not (NOTEBOOKS / link).is_file()] == []
    for other in NAMES:
        (tmp_path / f"{other}.html").touch()
    page = linked("".join(f'<a href="{link}">' for link in links), tmp_path)
    led = re.findall(r'<a href="([^"]*)">', page)
    assert len(led) == len(links) and all((tmp_path / link).is_file() for link in led)
    assert not any(link.endswith(".ipynb") for link in led)
    if name != NAMES[-1]:
        assert f"({NAMES[NAMES.index(name) + 1]}.ipynb)" in words[-1].split("Next: ")[-1]


def test_links_of_a_page_that_lead_nowhere_or_elsewhere(tmp_path: Path) -> None:
    """To a file that is not there is no link; those into the page and out of it stay."""
    elsewhere = '<a href="#top"><a href="https://example.org/a.ipynb">'
    assert linked(f'<a href="../none.md">{elsewhere}', tmp_path) == f"<a>{elsewhere}"
    page = linked('<a href="../docs/words.md#renamed">', tmp_path / "some")
    path = re.findall(r'<a href="(.*)#renamed">', page)[0]
    (tmp_path / "some").mkdir()
    assert (tmp_path / "some" / path).resolve() == ROOT / "docs" / "words.md"


def test_the_lab_asks_for_no_build(monkeypatch: pytest.MonkeyPatch) -> None:
    """`make lab` starts it with a folder of settings, which turn its dialog off."""
    config = pytest.importorskip("jupyterlab_server.config")
    (folder,) = re.findall(r'JUPYTER_CONFIG_PATH="\$\(CURDIR\)/([\w/]+)', MAKEFILE)
    monkeypatch.setenv("JUPYTER_CONFIG_PATH", str(ROOT / folder))
    told = config.get_static_page_config(level="all")
    assert told["buildAvailable"] is False and told["buildCheck"] is False


def test_a_long_function_would_be_noticed() -> None:
    tree = python_of("%matplotlib inline\ndef f():\n" + "    pass\n" * 6)
    assert functions(tree) == [("f", 7)]


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow if t == "slow" else ()) for n, t in TIERS.items()],
)
def test_a_notebook_runs_and_shows_pictures(
    name: str, smoke_results: Results, tmp_path: Path
) -> None:
    executed = execute(NOTEBOOKS / f"{name}.ipynb", tmp_path, smoke_results)
    notebook = read(executed)
    shown = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in shown)
    assert not [o for o in shown if o.output_type == "error" or o.get("name") == "stderr"]
    page = (tmp_path / f"{name}.html").read_text(encoding="utf-8")
    assert 10_000 < len(page) < 15_000_000 and fetched(page) == []
    assert sorted(p.suffix for p in tmp_path.iterdir()) == [".html", ".ipynb"]


def small_notebook(path: Path, source: str) -> Path:
    cell = nbformat.v4.new_code_cell(source)
    nbformat.write(nbformat.v4.new_notebook(cells=[cell]), path)
    return path


def test_a_cell_that_fails_is_told_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = tmp_path / "notebooks"
    source.mkdir()
    small_notebook(source / "bad.ipynb", "1 / 0")
    (source / MANIFEST).write_text("bad: { tier: quick, needs: [] }")
    monkeypatch.setattr(notebooks, "NOTEBOOKS", source)
    (tmp_path / "out").mkdir()
    results = Results(PROFILES["smoke"], tmp_path)
    with pytest.raises(NotebookError, match=r"^bad.ipynb could not be executed: ZeroDivisionError"):
        notebooks.run_notebooks(results, tmp_path / "out")
    small_notebook(source / "bad.ipynb", "import os; print(os.environ['VRCHAIN_PROFILE'])")
    assert notebooks.run_notebooks(results, tmp_path / "out").startswith("executed 1 notebooks")
    written = read(tmp_path / "out" / "bad.ipynb")
    assert written.cells[0].outputs[0].text == "smoke\n"
