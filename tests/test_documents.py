"""The documents: their links lead somewhere, their Python runs and uses public names alone."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib
import pytest
import typer
from snippets import blocks, strangers
from worlds import ROOT

import vrchain as vr
from vrchain.cli import app

DOCUMENTS = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
API, SCRIPT, MATCHER, CLI, ARCHITECTURE, REPRODUCTION = (
    ROOT / "docs" / name
    for name in (
        "reference/api.md",
        "python.md",
        "how-to/own-matcher.md",
        "reference/cli.md",
        "architecture.md",
        "reproduction.md",
    )
)
LONG = "# takes minutes"  # the first line of a block that is not run
_LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
_CODE = re.compile(r"^```.*?^```$|^ {4}.*$|`[^`\n]*`", re.MULTILINE | re.DOTALL)


def name(document: Path) -> str:
    return str(document.relative_to(ROOT))


def anchors(document: Path) -> set[str]:
    """Of the headings, as GitHub makes them."""
    heads = re.findall(r"^#+ (.*)$", document.read_text(encoding="utf-8"), re.MULTILINE)
    plain = [re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", head).strip().lower() for head in heads]
    return {re.sub(r"[^\w\- ]", "", head).replace(" ", "-") for head in plain}


@pytest.mark.parametrize("document", DOCUMENTS, ids=name)
def test_every_link_leads_to_a_file_and_a_heading(document: Path) -> None:
    wrong = []
    for link in _LINK.findall(_CODE.sub("", document.read_text(encoding="utf-8"))):
        path, _, anchor = link.partition("#")
        if "://" in link:
            continue
        there = (document.parent / path).resolve() if path else document
        if not there.exists() or (anchor and anchor not in anchors(there)):
            wrong.append(link)
    assert wrong == []


def test_documents_that_code_names_are_there() -> None:
    sources = [f for folder in ("vrchain", "tests", "tools") for f in (ROOT / folder).rglob("*.py")]
    for source in (*sources, ROOT / "Makefile", ROOT / "pyproject.toml"):
        for named in re.findall(r"\bdocs/[\w/-]+\.md\b", source.read_text(encoding="utf-8")):
            assert (ROOT / named).is_file(), f"{source} names {named}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=name)
def test_python_in_a_document_uses_public_names_alone(document: Path) -> None:
    """How-to pages may go deeper: what they import is there."""
    for block in blocks(document.read_text(encoding="utf-8")):
        tree = ast.parse(block)
        if document.parent.name != "how-to":
            assert strangers(tree) == []
        for part in tree.body:
            if isinstance(part, ast.Import | ast.ImportFrom):
                exec(ast.unparse(part), {})


def test_the_reference_names_what_the_package_gives() -> None:
    named = re.findall(r"^### `(.*)`$", API.read_text(encoding="utf-8"), re.MULTILINE)
    rooms = {"play": vr.play, "plots": vr.plots}
    given = [*vr.__all__, *(f"{room}.{name}" for room in rooms for name in rooms[room].__all__)]
    assert sorted(named) == sorted(given)
    assert all(set(room.__all__) <= set(dir(room)) for room in (vr, *rooms.values()))


@pytest.mark.parametrize("package", ["", "play", "plots"])
def test_type_checkers_are_told_the_names_that_are_given(package: str) -> None:
    tree = ast.parse((ROOT / "vrchain" / package / "__init__.py").read_text(encoding="utf-8"))
    told, _ = (part for part in tree.body if isinstance(part, ast.If))
    names = [alias.asname for part in told.body for alias in part.names]  # type: ignore[attr-defined]
    assert sorted(names) == sorted((getattr(vr, package) if package else vr).__all__)


def test_the_readme_is_a_page() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 60


def test_another_name_is_refused() -> None:
    with pytest.raises(AttributeError, match="module 'vrchain' has no attribute 'nothing'"):
        vr.nothing  # type: ignore[attr-defined]  # noqa: B018


@pytest.mark.parametrize("document", [API, SCRIPT, MATCHER], ids=name)
def test_the_python_of_a_document_runs(
    document: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    matplotlib.use("agg")
    known: dict[str, object] = {"vr": vr}
    for block in blocks(document.read_text(encoding="utf-8")):
        code = compile(block, name(document), "exec")
        if not block.startswith(LONG):
            exec(code, known)


def commands(command: Any, path: str = "vrchain") -> Iterator[tuple[str, Any]]:
    for word, below in getattr(command, "commands", {}).items():
        yield from commands(below, f"{path} {word}")
    if not hasattr(command, "commands"):
        yield path, command


def test_the_page_of_the_command_line_names_every_command_and_option() -> None:
    """Of each: a section, and in it a row for each option."""
    _, *parts = CLI.read_text(encoding="utf-8").split("\n### ")
    written = {part.partition("\n")[0]: part for part in parts}
    given = dict(commands(typer.main.get_command(app)))
    assert set(written) == set(given)
    for path, command in given.items():
        options = [p for p in command.params if p.param_type_name == "option"]
        rows = re.findall(r"^\| `(-[^|]*)`[^`|]*\|", written[path], re.MULTILINE)
        assert rows == ["`, `".join(option.opts) for option in options], path


def test_the_ten_questions_lead_to_a_definition() -> None:
    """The first name of each answer is defined in the first file or folder beside it."""
    rows = re.findall(
        r"^\| [^|]*\? \| `(\w+)`[^|]*\| \[[^\]]*\]\(\.\./([^)]*)\)",
        ARCHITECTURE.read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    assert len(rows) == 10
    for defined, where in rows:
        there = ROOT / where
        files = [there] if there.is_file() else there.rglob("*.py")
        pattern = rf"^(def|class) {defined}\b|^{defined}\b.* = "
        assert any(re.search(pattern, f.read_text("utf-8"), re.MULTILINE) for f in files), defined


VERDICTS = {"holds", "holds with limits", "cannot be checked", "does not hold"}
PAPER_SECTIONS = (  # those that claim something, and what they claim it by
    "Abstract",
    "Introduction",
    "State of the Art",
    "Methodology and Framework Design",
    "Motivating Example",
    "Navigation Use Case",
    "Panoramic State Update",
    "Evaluation",
    "Performance Evaluation",
    "Latency and Transmission Time Overhead",
    "Scalability and Throughput",
    "Denial of Service (DoS)",
    "Conclusions",
    *("figure 1", "figure 5", "figure 6", "figure 7", "table I"),
)


def rows_below(header: str, document: Path) -> list[list[str]]:
    """The rows of every table with this header, as cells."""
    text = document.read_text(encoding="utf-8")
    _, *tables = text.split(f"\n{header}\n")
    below = [table.split("\n\n")[0].splitlines()[1:] for table in tables]
    return [row.strip("| ").split(" | ") for rows in below for row in rows]


def leads_somewhere(link: str, document: Path) -> bool:
    path, _, anchor = link.partition("#")
    there = (document.parent / path).resolve() if path else document
    return there.exists() and (not anchor or anchor in anchors(there))


def test_every_claim_of_the_paper_has_a_verdict_and_a_link() -> None:
    claims = rows_below("| claim | in the paper | here | verdict |", REPRODUCTION)
    assert len(claims) >= 40
    for claim, _, here, verdict in claims:
        assert verdict in VERDICTS, claim
        assert any(leads_somewhere(link, REPRODUCTION) for link in _LINK.findall(here)), claim
    assert {row[-1] for row in claims} == VERDICTS
    told = {part.strip() for _, where, *_ in claims for part in re.split("[;,]", where)}
    assert set(PAPER_SECTIONS) <= told


def test_every_open_question_says_what_shows_it_or_that_nothing_does() -> None:
    questions = rows_below("| question | answer so far | shown by |", REPRODUCTION)
    assert len(questions) >= 9
    for question, answer, shown in questions:
        assert question.endswith("?") and answer, question
        assert any(leads_somewhere(link, REPRODUCTION) for link in _LINK.findall(shown)), question
