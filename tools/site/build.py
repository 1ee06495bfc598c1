"""The documents, the executed notebooks and a gallery of figures as one static site.

    python tools/site/build.py [PROFILE]

Pages are copied with their links made to hold on the site; mkdocs renders them into build/site and
checks the links. Nothing is fetched. What `make reproduce` has not made yet is left out, and named.
"""

import base64
import hashlib
import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE, BUILD = Path(__file__).parent, ROOT / "build"
SOURCE, SITE = BUILD / "site-source", BUILD / "site"
NEEDS = "mkdocs-material>=9.6,<10"  # MIT; with mkdocs, BSD
PAGES = {"README.md": "about.md"}  # for the first page is the gallery
NO_PAGES = (".venv", "build", "tests", "shared", "node_modules")
_LINK = re.compile(r"(\]\(|<a href=\"|<img src=\")([^)\s\"#]+)(#[^)\s\"]*)?([)\"])")
_CODE = re.compile(r"(^```.*?^```$|`[^`\n]*`)", re.MULTILINE | re.DOTALL)
_DATA = re.compile(r'src="data:image/(\w+);base64,([^"]+)"')
_CONTROLS = re.compile(r"^ {4}VBox\(.*$", re.MULTILINE)
_FRAME = re.compile(r"<iframe srcdoc.*?</iframe>", re.DOTALL)
_ROW = re.compile(r"^\| (\w+) \| (.*?) \| \[", re.MULTILINE)  # of docs/results/figures.md


def main(profile: str = "quick") -> int:
    """Build it; what is missing is named. The exit status."""
    if find_spec("material") is None:
        print(
            "make site needs mkdocs-material and nbconvert in a Python of their own: "
            f"python3 -m venv build/venv && build/venv/bin/pip install '{NEEDS}' nbconvert && "
            "make site SITE_PYTHON=build/venv/bin/python"
        )
        return 1
    results = BUILD / profile
    shutil.rmtree(SOURCE, ignore_errors=True)
    missing = [*write_notebooks(results), *write_gallery(results)]
    for page in pages():
        write(page, (ROOT / page).read_text(encoding="utf-8"))
    for name in ("iframe-worker.js", "site.css"):
        copy(HERE / name, f"assets/{name}")
    config = BUILD / "mkdocs.yml"
    config.write_text(configuration(), encoding="utf-8")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-f", str(config)]
    done = subprocess.run(command, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, check=False)
    if missing:
        print(f"left out, as `make reproduce` has not made them: {', '.join(missing)}")
    if done.returncode == 0:
        print(f"wrote {SITE.relative_to(ROOT)}/index.html")
    return done.returncode


def pages() -> list[str]:
    """The documents, by their path in the repository."""
    found = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]
    return sorted(str(path.relative_to(ROOT)) for path in found)


def configuration() -> str:
    """mkdocs.yml, with folders of the navigation spelt out."""
    text = (HERE / "mkdocs.yml").read_text(encoding="utf-8")
    listed = set(re.findall(r"^  - .*: (\S+\.md)$", text, re.MULTILINE))
    for folder in re.findall(r"^  - .*: ([\w/-]+)$", text, re.MULTILINE):
        inside = sorted(str(p.relative_to(SOURCE)) for p in (SOURCE / folder).glob("*.md"))
        lines = "".join(f"\n      - {page}" for page in inside if page not in listed)
        text = re.sub(rf"(?m)^(  - .*:) {folder}$", rf"\1{lines}", text)
    return f"docs_dir: {SOURCE}\nsite_dir: {SITE}\n{text}"


def place_of(path: Path) -> str | None:
    """Where a file of the repository is on the site; None for what is not there."""
    if not path.is_relative_to(ROOT):
        return None
    name = str(path.relative_to(ROOT))
    if name == "notebooks":
        return "notebooks/01_scene.md"
    if path.suffix == ".ipynb":
        return str(Path(name).with_suffix(".md"))
    if path.suffix in (".md", ".png", ".jpg", ".gif"):
        return PAGES.get(name, name)
    return f"files/{name}.txt" if path.is_file() else None


def write(page: str, text: str) -> None:
    """A page onto the site, its links led to where their files are there."""
    here = Path(place_of(ROOT / page) or page)

    def led(link: re.Match[str]) -> str:
        opens, target, anchor, closes = link[1], link[2], link[3] or "", link[4]
        made = (SOURCE / here.parent / target).is_file()  # as nbconvert's pictures
        if made or "://" in target or target.startswith(("data:", "mailto:")):
            return link[0]
        there = (ROOT / page).parent / target
        place = place_of(there.resolve())
        if place is None:  # a folder, or what is not in the repository: no link
            return f"{opens}{os.path.relpath('about.md', here.parent)}{closes}"
        if not place.endswith(".md"):
            copy(there.resolve(), place)
        return f"{opens}{os.path.relpath(place, here.parent)}{anchor}{closes}"

    parts = _CODE.split(text)
    parts[::2] = [_LINK.sub(led, part) for part in parts[::2]]
    target = SOURCE / here
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text("".join(parts), encoding="utf-8")


def copy(file: Path, place: str) -> None:
    """A file as it is."""
    (SOURCE / place).parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(file, SOURCE / place)


def write_notebooks(results: Path) -> list[str]:
    """The notebooks as pages, executed where they were; the names of those that were not."""
    missing, into = [], SOURCE / "notebooks"
    for stored in sorted((ROOT / "notebooks").glob("*.ipynb")):
        executed = results / "notebooks" / stored.name
        if not executed.is_file():
            missing.append(f"notebook {stored.stem}")
        command = [
            sys.executable, "-m", "nbconvert", "--log-level=ERROR", "--to", "markdown",
            str(executed if executed.is_file() else stored), "--output-dir", str(into),
        ]  # fmt: skip
        subprocess.run(command, check=True)
        page = into / f"{stored.stem}.md"
        text = _FRAME.sub("*(A scene to walk around in: `make lab`.)*", page.read_text("utf-8"))
        text = _CONTROLS.sub("*(Here are controls when it runs: `make lab`.)*", text)
        text = text.replace("<details>", '<details markdown="1">')
        text = _DATA.sub(lambda found: f'src="{extracted(found, into)}"', text)
        write(f"notebooks/{stored.stem}.md", text)
    return missing


def extracted(found: re.Match[str], folder: Path) -> str:
    """A picture that was in a page, as a file of its own; its name."""
    name = f"picture_{hashlib.sha256(found[2].encode()).hexdigest()[:12]}.{found[1]}"
    (folder / name).write_bytes(base64.b64decode(found[2]))
    return name


def write_gallery(results: Path) -> list[str]:
    """The first page: every figure that is there, with what it shows. Those that are not."""
    table = (ROOT / "docs" / "results" / "figures.md").read_text(encoding="utf-8")
    cards, missing = [], []
    for name, shows in _ROW.findall(table):
        drawn = [p for p in (results / "figures" / f"{name}.png", ROOT / "figures" / f"{name}.png")
                 if p.is_file()]  # fmt: skip
        if not drawn:
            missing.append(f"figure {name}")
            continue
        copy(drawn[0], f"figures/{name}.png")
        copy(ROOT / "figures" / f"{name}.py", f"files/figures/{name}.py.txt")
        picture = f'<a href="figures/{name}.png"><img src="figures/{name}.png" alt="{name}"></a>'
        links = [f'<a href="files/figures/{name}.py.txt">script</a>']
        made = drawn[0].parent
        of = "paper" if made == ROOT / "figures" else results.name
        for said, file in (("data", f"{name}.csv"), ("commit", "manifest.json")):
            if (made / file).is_file():
                copy(made / file, f"files/{of}/{file}")
                links.append(f'<a href="files/{of}/{file}">{said}</a>')
        told = f"{shows} ({', '.join(links)})"
        cards.append(f"<figure>{picture}<figcaption>{told}</figcaption></figure>")
    first = (ROOT / "README.md").read_text(encoding="utf-8").split("\n\n")[1]
    text = f"# VRChain\n\n{first}\n\n"
    text += "![A mission to a barn behind walls](docs/mission.png)\n\n"
    text += '## Figures\n\n<div class="gallery">\n'
    copy(ROOT / "docs" / "mission.png", "docs/mission.png")
    (SOURCE / "index.md").write_text(text + "\n".join(cards) + "\n</div>\n", encoding="utf-8")
    return missing


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:2]))
