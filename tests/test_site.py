"""The site: links of a page lead to where things are on it; the whole is built where it can be."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
from pages import fetched
from worlds import ROOT


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("site_build", ROOT / "tools/site/build.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name, folder in {"BUILD": "", "SOURCE": "source", "SITE": "site"}.items():
        monkeypatch.setattr(module, name, tmp_path / folder)
    return module


def test_links_lead_to_pages_files_and_nowhere_else(site: ModuleType) -> None:
    page = (
        "[a](../words.md#renamed) [n](../../notebooks/04_ledger.ipynb) [r](../../README.md)\n"
        "[s](../../figures/table.py) [f](../../notebooks) [w](https://example.org/a.md)\n"
        "`[code](../words.md)`\n```\n[code](../words.md)\n```\n"
    )
    site.write("docs/results/latency.md", page)
    written = (site.SOURCE / "docs/results/latency.md").read_text()
    assert re.findall(r"\]\(([^)]*)\)", written) == [
        "../words.md#renamed", "../../notebooks/04_ledger.md", "../../about.md",
        "../../files/figures/table.py.txt", "../../notebooks/01_scene.md",
        "https://example.org/a.md", "../words.md", "../words.md",
    ]  # fmt: skip
    assert (site.SOURCE / "files/figures/table.py.txt").is_file()


def test_pictures_in_a_page_become_files(site: ModuleType, tmp_path: Path) -> None:
    (found,) = site._DATA.finditer('<img src="data:image/gif;base64,R0lG">')
    name = site.extracted(found, tmp_path)
    assert name.endswith(".gif") and (tmp_path / name).read_bytes() == b"GIF"


def test_what_is_not_made_yet_is_named(site: ModuleType, tmp_path: Path) -> None:
    site.SOURCE.mkdir()
    missing = site.write_gallery(tmp_path / "nothing")
    drawn = {path.stem for path in (ROOT / "figures").glob("*.png")}
    scripts = {path.stem for path in (ROOT / "figures").glob("*.py")}
    assert {name.removeprefix("figure ") for name in missing} == scripts - drawn
    first = (site.SOURCE / "index.md").read_text()
    assert "out of sight" in first
    assert len(re.findall("<figure>", first)) == len(scripts - {m.split()[1] for m in missing})
    links = re.findall(r'href="([^"]*)"', first)
    assert {"files/paper/table.csv", "files/paper/manifest.json"} <= set(links)
    assert all((site.SOURCE / link).is_file() for link in links)


def test_without_mkdocs_it_is_said_what_to_install(
    site: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(site, "find_spec", lambda name: None)
    assert site.main() == 1
    assert "make site needs mkdocs-material" in capsys.readouterr().out
    assert not site.SOURCE.exists()


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("material") is None, reason="needs mkdocs-material")
def test_the_site_is_built_fetches_nothing_and_is_searchable() -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "tools/site/build.py"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    built = ROOT / "build" / "site"
    for page in built.rglob("*.html"):
        links = fetched(page.read_text(encoding="utf-8"))
        assert [link for link in links if "://" in link] == [], page
    assert "carried over" in (built / "search" / "search_index.js").read_text(encoding="utf-8")
