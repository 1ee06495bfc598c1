"""A mission in pictures, and replayed: what each decision rested on, when, and for how long."""

import io
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from drawn import strays, words
from driven import driven, panorama
from PIL import Image

from vrchain.navigation.settings import Decision
from vrchain.plots.missions import mission_figure, save_pictures
from vrchain.plots.replay import Frame, gif_html, mission_gif, replay


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return list(replay(driven()))


def test_decisions_are_shown_long_enough_to_be_read(frames: list[Frame]) -> None:
    shown_ms = [frame.shown_ms for frame in frames]
    assert len(frames) == 42  # twice a second, and once between
    assert [k for k, ms in enumerate(shown_ms) if ms >= 1000] == [0, 13, 41]
    assert max(shown_ms) == shown_ms[-1] and sum(shown_ms) < 12_000


def test_what_stands_still_is_not_drawn_anew(frames: list[Frame]) -> None:
    """Beside the map only decisions change anything; on it, the robot that drives."""
    width = frames[0].rgb.shape[1]
    differs = [(b.rgb != a.rgb).any(axis=(0, 2)) for a, b in pairwise(frames)]
    beside = [d[width // 2 :].any() for d in differs]
    assert [k for k, changed in enumerate(beside, 1) if changed] == [13, 41]
    moves = [d[: 4 * width // 10] for d in differs[:-1]]
    assert all(d.any() and d.mean() < 0.2 for d in moves)
    ahead = [int(np.flatnonzero(d).max()) for d in moves]
    assert ahead == sorted(ahead)  # east is to the right


def test_the_look_by_which_it_decided_is_shown(frames: list[Frame]) -> None:
    def greys(frame: Frame) -> set[int]:
        return {grey for grey in (60, 120, 200) if (frame.rgb == grey).all(axis=2).sum() > 5000}

    assert [greys(frames[k]) for k in (0, 12, 13, 41)] == [{60, 120}, {60, 120}] + [{120, 200}] * 2


def test_the_animation_is_the_same_each_time_and_as_long_as_its_frames() -> None:
    gif = mission_gif(driven())
    assert gif == mission_gif(driven())
    image, shown_ms = Image.open(io.BytesIO(gif)), 0
    for k in range(image.n_frames):
        image.seek(k)
        shown_ms += image.info["duration"]
    assert shown_ms == sum(frame.shown_ms for frame in replay(driven()))
    assert image.info["loop"] == 0


def test_a_mission_that_ended_at_once_is_shown_too() -> None:
    run = driven()
    decided = (Decision(10.0, "gave up", "it cannot see"),)
    result = replace(run.result, decisions=decided, looks=(), plans=(), arrived=False)
    (frame,) = replay(replace(run, result=result, seconds=0.0, times_s=np.array([10.0]),
        paths_xy_m={name: path[:1] for name, path in run.paths_xy_m.items()}))  # fmt: skip
    assert frame.rgb.std() > 10


def test_the_animation_is_a_picture_of_a_page() -> None:
    page = gif_html(b"GIF89a...", 'R1 & "the barn"')
    assert page.startswith('<img src="data:image/gif;base64,R0lGODlh')
    assert 'alt="R1 &amp; &quot;the barn&quot;"' in page


def test_all_that_decisions_rested_on_is_saved(tmp_path: Path) -> None:
    run = replace(driven(), pictures=(panorama(10), panorama(20)))
    save_pictures(run, tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    pictures = {"goal_1.png", "goal_2.png", "look_0.jpg", "look_1.jpg", "plan_1_leg_1.png"}
    assert names == {"mission.png", *pictures}
    look = np.asarray(Image.open(tmp_path / "look_1.jpg"))
    assert look.shape == run.result.looks[1].cylinder.shape
    assert np.abs(look.astype(int) - 200).max() <= 2


def test_the_chain_and_the_end_are_shown() -> None:
    figure = mission_figure(driven())
    shown = words(figure)
    assert {"R1 sees", "R2 sees", "R1's last look around", "L12", "goal"} <= set(shown)
    assert shown.count("L12") == 2  # in what both see
    assert strays(figure) == []


def test_without_a_plan_the_last_look_is_shown() -> None:
    run = driven()
    alone = replace(run, result=replace(run.result, plans=(), arrived=False, reason="boxed in"))
    shown = words(mission_figure(alone))
    assert "R1's last look around" in shown and not any(w.endswith(" sees") for w in shown)
    assert any("gave up: boxed in" in w for w in shown)
