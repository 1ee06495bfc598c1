"""What is shown for each value of the controls, without a browser, and said of a bad one."""

from pathlib import Path
from typing import Any

import IPython.display
import numpy as np
import pandas as pd
import pytest
from claims import claim, pair
from clusters import skip_without_servers
from drawn import words
from driven import driven
from ledgers import small_ledger
from matplotlib.figure import Figure
from worlds import yard

import vrchain as vr
from vrchain.errors import MissionError, PoseError, VRChainError
from vrchain.experiments.reproduction.results import PROFILES, Results
from vrchain.ledger.errors import NotALedgerError, NotFoundError
from vrchain.play.controls import Choice, Play, PlayError, Shown, Slider
from vrchain.play.teams import shortest_chain
from vrchain.simulation.sightings import Sightings

HOME = vr.Pose(0.0, 0.0)


def test_a_robot_that_turns_sees_the_same_and_one_that_drives_publishes() -> None:
    play = vr.play.drive(yard(), HOME)
    turned, far = play.at(heading_deg=90), play.at(x_m=5.5)
    assert "changed by 0.0" in turned.says and "**not yet**" in turned.says
    assert "5.5 m" in far.says and "**it publishes**" in far.says
    with pytest.raises(PoseError, match="is inside or within"):
        box = yard().objects[yard().index_of("box 0")]
        play.at(x_m=float(box.bounds_m[:, 0].mean()), y_m=float(box.bounds_m[:, 1].mean()))


def test_what_two_robots_see_is_found_or_it_is_said_why_not() -> None:
    play = vr.play.apart(yard(), HOME)
    shown = play.at(distance_m=2, direction_deg=40)
    assert shown.table is not None and len(shown.table) > 3
    assert list(shown.table.columns) == ["landmark", "found", "why"]
    right = shown.table[shown.table.found].why.str.startswith("right with probability ")
    assert right.all() and not shown.table[~shown.table.found].why.str.startswith("right").any()
    assert f"**{shown.table.found.sum()} of the {len(shown.table)} are found**" in shown.says
    with pytest.raises(PlayError, match="expected distance_m from 1 to 40, got 41"):
        play.at(distance_m=41)


def test_two_robots_stand_where_they_can_from_the_start() -> None:
    box = yard().objects[yard().index_of("box 0")]
    x_m, y_m = map(float, box.bounds_m.mean(axis=0)[:2])
    play = vr.play.apart(yard(), vr.Pose(x_m + 5.0, y_m))
    assert play.controls["direction_deg"].value != 180
    assert play.at().says.startswith("5 m apart")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("play") / "ledger"
    small_ledger(made)
    return made


@pytest.mark.parametrize(
    ("part", "notice"),
    [
        ("block 2: transaction", 4),
        ("block 2: panorama", 4),
        ("block 2", 2),  # its newest table is not read again by whoever reads panoramas
        ("block 0: genesis", 3),  # the witness has read it
    ],
)
def test_every_byte_of_a_ledger_is_watched(folder: Path, part: str, notice: int) -> None:
    """The first, one within, and the last; by `verify` at least."""
    play = vr.play.tamper(folder)
    last = int(play.at(part=part).highest["byte"])
    for at in (0, last // 2, last):
        shown = play.at(part=part, byte=at, bit=3)
        assert f"**{notice} of 4 notice**" in shown.says and shown.table is not None
        assert not shown.table.says[2:].str.startswith("nothing").any()
        assert any("→" in text for text in words(shown.figure))
    assert vr.verify(folder).ok  # a copy was changed


def test_nothing_changed_is_nothing_noticed_and_what_is_not_there_is_named(folder: Path) -> None:
    play = vr.play.tamper(folder)
    shown = play.at()
    assert shown.table is not None and shown.table.says.str.startswith("nothing").all()
    parts = play.controls["part"]
    assert isinstance(parts, Choice) and "block 3: enrolment" in parts.options
    with pytest.raises(PlayError, match=r"expected part of nothing, block 0, .*, got 'block 9'"):
        play.at(part="block 9")
    with pytest.raises(NotFoundError, match="expected of block 2 a byte of 0 to"):
        vr.tampering.change_byte(folder, "block 2", 10_000)
    with pytest.raises(NotFoundError, match="expected a part of block 0"):
        vr.tampering.change_byte(folder, "block 9", 0)
    with pytest.raises(NotALedgerError):
        vr.play.tamper(folder / "nowhere")


def results_with(folder: Path) -> Results:
    results = Results(PROFILES["smoke"], folder)
    stage = results.folder / "landmarks"
    stage.mkdir(parents=True)
    claims = [claim(0, 0, 0.9), claim(0, 0, 0.6, False), claim(0, 0, 0.3)]
    pd.DataFrame(claims).assign(band_m="1-10").to_csv(stage / "pairs.csv")
    pd.DataFrame([pair(0, 0)]).assign(band_m="1-10").to_csv(stage / "pairs_drawn.csv")
    (stage / "stage.json").write_text(results.marker("landmarks"))
    return results


def test_a_lower_threshold_finds_more_and_errs_more(tmp_path: Path) -> None:
    play = vr.play.threshold(results_with(tmp_path))
    rows = {t: play.at(threshold=t).table for t in (0.95, 0.9, 0.5, 0.1)}
    told = {t: [*table.iloc[0, 1:].fillna(-1)] for t, table in rows.items() if table is not None}
    assert told == {0.95: [-1, 0], 0.9: [1, 0.25], 0.5: [0.5, 0.25], 0.1: [0.667, 0.5]}
    with pytest.raises(VRChainError, match="run `vrchain reproduce --profile smoke"):
        vr.play.threshold(Results(PROFILES["smoke"], tmp_path / "none"))


def test_a_mission_is_replayed_decision_by_decision() -> None:
    play = vr.play.replay(driven())
    first, last = play.at(), play.at(decision=3)
    assert "decision 1 of 4: **route** - why route" in first.says
    assert "After 20 s, decision 4 of 4: **arrived**" in last.says
    assert last.table is not None and list(last.table.decision)[-1] == "arrived"
    believed = " ".join(words(last.figure))
    assert (
        "R2 sees the goal: 0.90" in believed and "this leads to the goal at all: 1.00" in believed
    )
    with pytest.raises(PlayError, match="expected decision from 0 to 3, got 4"):
        play.at(decision=4)


def test_home_is_where_the_methods_say_it_is() -> None:
    play = vr.play.homing(yard(), HOME)
    assert "epipolar is **0 degrees off**" in play.at().says
    assert "epipolar says: **this is home**" in play.at(east_m=0, turned_deg=0).says
    with pytest.raises(PlayError, match=r"expected method of epipolar, .*, got 'compass'"):
        play.at(method="compass")


def test_in_the_barnyard_the_sliders_reach_behind_both_walls() -> None:
    """The exercise of the homing notebook."""
    barn, home = vr.load_scene(vr.SCENES / "barn.yaml"), vr.Pose(0.0, -12.0)
    north = vr.play.homing(barn, home).controls["north_m"]
    assert isinstance(north, Slider)
    truth = vr.GroundTruth(barn)
    for north_m in (north.low, north.high):
        here = vr.Pose(home.x_m, home.y_m + north_m)
        barn.check_pose(here)
        hit, way = truth.cast(np.array([*here.xy_m, 1.0]), np.array([[0.0, -north_m, 0.0]]))
        assert way.item() < 1 and barn.objects[hit.item()].kind == "wall"


SEEN = Sightings(
    {"R1": ("oak", "elm"), "R2": ("oak", "shed"), "R3": ("shed", "elm", "barn")},
    {("R1", "R2"): ("oak",), ("R1", "R3"): ("elm",), ("R2", "R3"): ("shed",)},
)


def test_the_chain_is_planned_again_without_what_is_crossed_out() -> None:
    robots = ["R1", "R2", "R3"]
    assert shortest_chain(robots, SEEN, "barn") == ["R1", "elm", "R3", "barn"]
    assert shortest_chain(robots, SEEN, "oak") == ["R1", "oak"]
    assert shortest_chain(robots, SEEN, "mill") is None
    barn = vr.load_scene(vr.SCENES / "barn.yaml")
    play = vr.play.team(barn)
    assert "**R1 - L12 - R2 - L23 - R3 - barn**" in play.at().says
    crossed = play.at(without=("L12: shed",))
    assert "no chain leads to the goal" in crossed.says
    assert "no chain leads to the barn" in crossed.figure.axes[0].get_title()
    with pytest.raises(PlayError, match=r"expected without of L12: shed, .* got 'oak'"):
        play.at(without="oak")
    with pytest.raises(MissionError, match=r"name them, as in team\(scene"):
        vr.play.team(yard())
    with pytest.raises(MissionError, match=r"expected a goal of .*, got 'moon'"):
        vr.play.team(barn, goal="moon")


def test_of_three_servers_one_may_break_and_with_two_gone_all_waits() -> None:
    skip_without_servers()
    play = vr.play.machines()
    whole, one, two = play.at(), play.at(stopped=1, robot="R2"), play.at(stopped=2)
    back = play.at(robot="R2")
    tables = [shown.table for shown in (whole, one, two, back)]
    assert [list(table.panoramas) for table in tables if table is not None] == [
        [1, 1], [2, 2], [2, 2], [4, 4],
    ]  # fmt: skip
    assert "not in the chain" in two.says and "every folder" in back.says
    for table, waiting in zip(tables, (0, 0, 1, 0), strict=True):
        assert table is not None
        assert table["head"].nunique() == 1 and table["waiting in its outbox"].sum() == waiting


def test_a_control_that_there_is_not_and_a_value_that_is_none() -> None:
    play = Play(lambda a: Shown(str(a), Figure()), {"a": Slider("a", 0, 4, 1, 2)})
    assert play.at().says == "2" and play.at(a=4).says == "4"
    for wrong in ("3", True, None, 5):
        with pytest.raises(PlayError, match="expected a from 0 to 4, got"):
            play.at(a=wrong)
    with pytest.raises(PlayError, match="expected controls of a, got 'b'"):
        play.at(b=1)


class Page:
    """What a notebook would show: controls, and slots that are written again."""

    def __init__(self) -> None:
        self.outputs: list[Any] = []

    def display(self, shown: Any, **how: Any) -> "Slot":
        self.outputs.append(shown)
        return Slot(self.outputs, len(self.outputs) - 1)


class Slot:
    def __init__(self, outputs: list[Any], at: int) -> None:
        self.outputs, self.at = outputs, at

    def update(self, shown: Any, **how: Any) -> None:
        self.outputs[self.at] = shown


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> Page:
    made = Page()
    monkeypatch.setattr(IPython.display, "display", made.display)
    return made


def counting(a: int) -> Shown:
    if a == 3:
        raise VRChainError("expected no 3")
    return Shown(f"a is {a}", Figure(figsize=(1 + a, 1)), pd.DataFrame({"a": [a]}))


def test_a_slider_that_is_moved_changes_picture_and_table(page: Page) -> None:
    pytest.importorskip("ipywidgets")
    Play(counting, {"a": Slider("a", 0, 4, 1, 2)})._ipython_display_()
    controls, says, picture, table = page.outputs
    assert says["text/markdown"] == "a is 2" and "<td>2</td>" in table["text/html"]
    controls.children[0].value = 4
    assert page.outputs[1]["text/markdown"] == "a is 4"
    assert page.outputs[2]["image/png"] != picture["image/png"]
    stays = page.outputs[2]
    controls.children[0].value = 3
    assert "VRChainError: expected no 3" in page.outputs[1]["text/html"]
    assert page.outputs[2] is stays


def test_without_widgets_the_picture_is_there_and_says_what_is_missing(
    page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vrchain.extras.find_spec", lambda name: None)
    Play(counting, {"a": Slider("a", 0, 4, 1, 2)})._ipython_display_()
    missing, says, picture, _ = page.outputs
    assert "pip install 'ipywidgets" in missing["text/plain"]
    assert says["text/markdown"] == "a is 2" and picture["image/png"].startswith(b"\x89PNG")
