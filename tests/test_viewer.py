"""The view of a scene in a notebook: one page that holds everything."""

import base64
import gzip
import io
import re
from pathlib import Path
from typing import Any

import nbformat
import pytest
import trimesh
import worlds
from pages import fetched, frames

from vrchain.cli.notebooks import execute
from vrchain.errors import OutputError, PoseError
from vrchain.experiments.reproduction.results import PROFILES, Results
from vrchain.geometry import Pose
from vrchain.viewer import view
from vrchain.world.model import Scene


def scene() -> Scene:
    return worlds.world(
        worlds.box('a "quoted" <box>', (3.0, 2.0), (1.0, 2.0, 3.0), worlds.blotches("a"))
    )


def geometry_in(page: str) -> Any:
    """The scene that a page holds, read by another reader."""
    (packed,) = re.findall(r'<script type="application/octet-stream" id="scene">([^<]+)<', page)
    glb = gzip.decompress(base64.b64decode(packed))
    return trimesh.load_scene(io.BytesIO(glb), file_type="glb")


def test_a_view_holds_the_whole_scene_and_fetches_nothing() -> None:
    shown = view(scene())
    assert fetched(shown.page) == []
    assert "$" not in re.sub(r"\$\{", "", shown.page)  # every blank of the template is filled
    assert set(geometry_in(shown.page).geometry) == {"ground", 'a "quoted" <box>'}
    assert frames(shown._repr_html_()) == [shown.page]


def test_a_view_is_told_in_a_line() -> None:
    """A notebook stores this text beside the page."""
    assert repr(view(scene(), height_px=400)) == "View(height_px=400)"


@pytest.mark.parametrize("pose", [(5.0, -3.0), Pose("5", 0.0), Pose(1e6, 0.0)])  # type: ignore[arg-type]
def test_a_robot_that_stands_nowhere_is_refused(pose: Any) -> None:
    with pytest.raises(PoseError, match=r"expected a pose of three finite|off the map"):
        view(scene(), {"R1": pose})


def test_robots_stand_at_their_poses_under_a_pin_that_points_ahead() -> None:
    found = geometry_in(view(scene(), {"R1": Pose(5.0, -3.0, 0.0)}).page)
    (low, high) = found.geometry["pin R1"].bounds
    assert high[0] == pytest.approx(9.0)  # the arrow, to the east
    assert (low[2] + high[2]) / 2 == pytest.approx(3.0)  # -z is north
    assert found.geometry["pin R1"].metadata["model"] == "R1"
    body = found.geometry["robot R1"].bounds
    assert body.mean(axis=0)[[0, 2]] == pytest.approx([5.0, 3.0], abs=0.2)


def test_smaller_textures_make_a_smaller_page_of_the_same_geometry() -> None:
    small, large = view(scene(), max_texture_px=8), view(scene())
    assert len(small.page) < len(large.page)
    for name, mesh in geometry_in(large.page).geometry.items():
        assert len(geometry_in(small.page).geometry[name].faces) == len(mesh.faces)


@pytest.mark.parametrize("wrong", [{"max_texture_px": 0}, {"height_px": -1}])
def test_sizes_below_a_pixel_are_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(OutputError, match="1 pixel and more"):
        view(scene(), **wrong)


def test_it_survives_the_conversion_of_a_notebook(tmp_path: Path) -> None:
    source = (
        "import sys\n"
        f"sys.path.insert(0, {str(worlds.ROOT / 'tests')!r})\n"
        "from worlds import yard\n"
        "from vrchain.viewer import view\n"
        "view(yard())"
    )
    cell = nbformat.v4.new_code_cell(source)
    notebook = tmp_path / "given.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=[cell]), notebook)
    (tmp_path / "out").mkdir()
    execute(notebook, tmp_path / "out", Results(PROFILES["smoke"], tmp_path))
    page = (tmp_path / "out" / "given.html").read_text()
    assert fetched(page) == []
    (inside,) = frames(page)
    assert set(geometry_in(inside).geometry) == {o.name for o in worlds.yard().objects}


@pytest.mark.parametrize(
    ("page", "address"),
    [
        ('<script src="https://a.example/b.js"></script>', "https://a.example/b.js"),
        ('<link rel="stylesheet" href="//a.example/b.css">', "//a.example/b.css"),
        ('<script>await import("https://a.example/c.mjs")</script>', "https://a.example/c.mjs"),
        ("<style>@import url(https://a.example/d.css)</style>", "https://a.example/d.css"),
        ('<iframe srcdoc="&lt;img src=&quot;e.png&quot;&gt;"></iframe>', "e.png"),
    ],
)
def test_what_would_be_fetched_is_noticed(page: str, address: str) -> None:
    assert fetched(page) == [address]
