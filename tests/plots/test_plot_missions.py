"""A mission in pictures: the map, and what each decision rested on."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image
from test_plot_replay import driven, panorama
from test_plots import strays, words

from vrchain.plots.missions import mission_figure, save_pictures


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
