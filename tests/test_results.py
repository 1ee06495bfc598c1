"""Reported figures: what README and the claims quote is recorded; made again, it is compared."""

import importlib.util
import json
import re
import shlex
import subprocess
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest
import typer
from worlds import ROOT

from vrchain.cli import app
from vrchain.experiments.reproduction.paper import READINGS, TABLE
from vrchain.plots.scripts import figure_names

# A decimal, or a whole number of something that is measured.
NUMBER = re.compile(
    r"(?<![\w.])(\d[\d,]*\.\d+|\d+(?=(?:(?:,| and) \d+)* (?:ms|MB|%|degrees)(?!\w)))"
)
COMMIT = re.compile(r"[0-9a-f]{7}")


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    spec = importlib.util.spec_from_file_location("results_tool", ROOT / "tools/results.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def quoted() -> Iterator[tuple[str, str]]:
    """Each number that README's table and the claims give as measured, with its page, in order."""
    # what stands beside "here", "answer" or "result" in the table's head
    for page, heads in (
        ("README.md", {"result"}),
        ("docs/reproduction.md", {"here", "answer so far"}),
    ):
        column = 0
        for line in (ROOT / page).read_text().splitlines():
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if not line.startswith("|"):
                column = 0
            elif found := heads.intersection(cells):
                column = cells.index(found.pop())
            elif column:
                text = re.sub(r"\]\([^)]*\)|`[^`]*`", "", cells[column])
                yield from ((page, number) for number in NUMBER.findall(text))


def meant(rows: pd.DataFrame) -> list[tuple[str, str, str, list[float]]]:
    """Page, number and figure of each quote, as quoted.csv has them, and what was measured.

    That is the figure's newest row, or the named commit's; ``paper``: all of the paper's table.
    """
    papers = [
        t * u for row in TABLE for t in (row.update, row.retrieval) for u in READINGS.values()
    ]
    found = []
    for _, said in pd.read_csv(
        ROOT / "figures/quoted.csv", dtype=str, keep_default_na=False
    ).iterrows():
        own = rows[(rows.figure == said.figure) & rows.commit.str.startswith(said.commit)]
        values = [*map(float, own[said.end or "value"].tail(1))]
        told = papers if said.figure == "paper" else values
        found.append((said.page, said.number, said.figure, told))
    return found


def is_rounded(number: str, values: list[float]) -> bool:
    digits = len(number.partition(".")[2])
    return number.replace(",", "") in {f"{value:.{digits}f}" for value in values}


def test_every_number_that_is_quoted_is_the_figure_that_is_meant(tool: ModuleType) -> None:
    """See CONTRIBUTING.md, Documents."""
    told = meant(tool.reported())
    assert len(told) > 100
    assert [*quoted()] == [(page, number) for page, number, *_ in told]
    assert [row for row in told if not is_rounded(row[1], row[3])] == []


def test_a_number_that_is_changed_by_hand_is_noticed(tool: ModuleType) -> None:
    """Each of them, in the page and in quoted.csv alike, though the new one be another figure's."""
    for _, number, figure, values in meant(tool.reported()):
        if figure != "paper":  # of which it is only known that the paper has it somewhere
            others = {number[:-1] + digit for digit in "0123456789"} - {number}
            assert not any(is_rounded(other, values) for other in others), (figure, number)


def test_a_figure_that_was_measured_anew_is_noticed_where_it_is_quoted(tool: ModuleType) -> None:
    rows = tool.reported()
    newer = rows[rows.figure == "ledger/update, 500 positions"].assign(value="2.50")
    told = meant(pd.concat([rows, newer]))
    old = [row[:2] for row in told if not is_rounded(row[1], row[3])]
    assert old == [("README.md", "1.79"), *[("docs/reproduction.md", "1.79")] * 2]


def test_rows_are_whole_and_of_commits_that_there_are(tool: ModuleType) -> None:
    rows = tool.reported()
    for _, row in rows.iterrows():
        float(row["value"])
        assert bool(row["low"]) == bool(row["high"]), row
        if row["low"]:
            assert float(row["low"]) <= float(row["value"]) <= float(row["high"]), row
        assert row["command"].startswith("vrchain ") and COMMIT.fullmatch(row["commit"]), row
    dates = rows.groupby("figure").date
    assert all(list(own) == sorted(own) for _, own in dates)  # the newest comes last
    shallow = subprocess.check_output(
        ["git", "-C", str(ROOT), "rev-parse", "--is-shallow-repository"], text=True
    )
    if shallow.strip() == "false":
        for commit in rows.commit.unique():
            subprocess.run(
                ["git", "-C", str(ROOT), "cat-file", "-e", f"{commit}^{{commit}}"], check=True
            )


def test_the_history_is_that_of_the_rows(tool: ModuleType) -> None:
    assert tool.HISTORY.read_text() == tool.history(tool.reported())


def some(**changed: str) -> pd.DataFrame:
    row = dict.fromkeys(
        [
            "figure",
            "value",
            "low",
            "high",
            "unit",
            "n",
            "seed",
            "commit",
            "date",
            "command",
            "where",
        ],
        "",
    )
    row |= {"figure": "a/b", "value": "0.5", "low": "0.4", "high": "0.6", "command": "vrchain x"}
    return pd.DataFrame([{**row, "where": "arm.success", **changed}])


@pytest.mark.parametrize(
    ("printed", "verdict"),
    [
        ({"success": 0.58, "success_ci": [0.5, 0.7]}, "within"),
        ({"success": 0.8, "success_ci": [0.7, 0.9]}, "MOVED"),
        ({"success": 0.2, "success_ci": None}, "MOVED"),
        ({"success": 0.55}, "within"),
    ],
)
def test_what_moved_beyond_its_interval_is_told(
    tool: ModuleType, printed: dict[str, object], verdict: str
) -> None:
    said: list[str] = []
    made = tool.made_again(some(), lambda command: {"arm": printed}, said.append)
    assert said[0].startswith(f"{verdict}: a/b: ") and len(made) == 1
    assert float(made.value[0]) == printed["success"] and COMMIT.match(made.commit[0])


def test_without_an_interval_a_twentieth_is_a_move(tool: ModuleType) -> None:
    row = some(low="", high="").iloc[0]
    assert [tool.has_moved(row, value, []) for value in (0.52, 0.53)] == [False, True]


def test_what_cannot_be_made_again_is_a_line(tool: ModuleType) -> None:
    def fails(command: str) -> object:
        raise RuntimeError("expected a scene")

    said: list[str] = []
    assert tool.made_again(some(), fails, said.append).empty
    assert tool.made_again(some(), lambda command: {"arm": {"other": 1.0}}, said.append).empty
    assert tool.made_again(some(where=""), fails, said.append).empty
    assert said == [
        "failed: vrchain x: expected a scene",
        "failed: vrchain x: 'success'",
        "by hand: vrchain x: a/b",
    ]


def test_nothing_is_run_that_is_not_named(
    tool: ModuleType, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tool, "made_again", None)
    tool.main([])
    told = capsys.readouterr().out.splitlines()
    assert {line.partition(":")[0] for line in told} == {"if named", "by hand"}
    assert len(told) == tool.newest(tool.reported()).command.nunique()


def test_each_condition_is_a_point_with_its_interval(tool: ModuleType) -> None:
    rows = tool.newest(tool.reported())
    under = rows[rows.figure.str.match("missions under .*/success")][::-1]
    panel = tool.conditions(tool.reported()).axes[0]
    names = [text.get_text() for text in panel.get_yticklabels()]
    assert [name.rpartition(" (")[0] for name in names] == [
        figure.removeprefix("missions under ").removesuffix("/success") for figure in under.figure
    ]
    points = panel.lines[0].get_xdata()
    assert list(points) == list(under.value.astype(float)) and len(points) >= 5
    ends = panel.collections[0].get_segments()
    told = under[["low", "high"]].astype(float).to_numpy()
    assert [[a[0], b[0]] for a, b in ends] == pytest.approx(told)


def test_missions_are_drawn_by_the_age_and_the_number_of_panoramas(tool: ModuleType) -> None:
    rows = tool.newest(tool.reported()).set_index("figure")
    silent, rarer = tool.ages(tool.reported()).axes
    for panel, first, at, names in (
        (silent, 0, (10,), "those eight, silent for {} min"),
        (rarer, 1, (3, 8), "those eight, rules {} times rarer"),
    ):
        under = ["eight missions as usual", *map(names.format, at)]
        for line, what in zip(panel.lines[:6:3], ("success", "spl_chain"), strict=True):
            told = [float(rows.value[f"missions under {name}/{what}"]) for name in under]
            assert line.get_xydata().tolist() == [
                [x, y] for x, y in zip((first, *at), told, strict=True)
            ]


def test_what_came_is_added_and_the_rows_before_are_left_as_they_were(
    tool: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    before, came = tool.RESULTS.read_text(), []
    monkeypatch.setattr(tool, "RESULTS", tmp_path / "results.csv")
    tool.RESULTS.write_text(before)
    monkeypatch.setattr(tool, "HISTORY", tmp_path / "history.md")
    for picture in ("CONDITIONS", "AGES"):
        monkeypatch.setattr(tool, picture, tmp_path / f"{picture}.png")
    monkeypatch.setattr(tool, "made_again", lambda rows: came.append(rows) or rows.tail(1))
    tool.main(["homing", "--write"])
    assert set(came[0].figure.str.partition("/")[0]) == {"homing"}
    after = tool.RESULTS.read_text()
    assert after.startswith(before) and after.count("\n") == before.count("\n") + 1
    assert tool.HISTORY.read_text() == tool.history(tool.reported(tool.RESULTS))
    tool.main(["all", "--write"])
    assert len(came[1]) == len(tool.newest(tool.reported()))


def test_the_commands_that_are_run_are_commands_and_options_that_there_are(
    tool: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    rows = tool.newest(tool.reported())
    for words in rows[rows["where"] != ""].command.unique():
        command, rest = typer.main.get_command(app), shlex.split(words)[1:]
        while hasattr(command, "commands"):
            command = command.commands[rest.pop(0)]
        command.make_context(words, [*rest, "--json"])


def test_a_name_that_no_figure_has_is_told_with_those_there_are(
    tool: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        tool.main(["landmark_s"])
    told = capsys.readouterr().err
    assert "expected all, or what begins with cluster" in told and "missions" in told


def committed(*words: str) -> bytes:
    """What git says of the checkout: what somebody has drawn since is not looked at."""
    return subprocess.check_output(["git", "-C", str(ROOT), *words])


def test_pictures_and_tables_are_those_of_the_manifest_and_small() -> None:
    made = json.loads(committed("show", ":figures/manifest.json"))
    assert made["command"] == "vrchain reproduce --profile paper" and not made["changed_since"]
    assert COMMIT.fullmatch(made["commit"])
    assert {*made["sha256"]} == {f"{n}.{kind}" for n in figure_names() for kind in ("csv", "png")}
    size = 0
    for name, digest in made["sha256"].items():
        content = committed("show", f":figures/{name}")
        size += len(content)
        assert sha256(content).hexdigest() == digest, f"{name}: make reproduce PROFILE=paper"
    assert size <= 6_000_000
