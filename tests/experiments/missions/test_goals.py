"""Is it the goal: the figures of a made-up table, and a small one that truly is looked at."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from vrchain.cli import app
from vrchain.errors import MissionError
from vrchain.experiments.missions import goals as goal_sights
from vrchain.experiments.missions.goals import RANGES_M, SIDES, as_table, evaluate, summarise
from vrchain.experiments.scenes import scenes_of
from vrchain.navigation.goal.recognition import GoalSight
from vrchain.paths import SCENES

SUBURB = SCENES / "suburb.yaml"
OTHER = "another house"


def looked_at(keypoints: list[int], own: bool = True) -> pd.DataFrame:
    """One house of each of two suburbs, with so many keypoints from each side, none from near."""
    rows = []
    for suburb in range(2):
        for side, n in enumerate(keypoints):
            for from_m, matches in zip(RANGES_M, (n, 0), strict=True):
                chance = 0.9 if matches else 0.0
                sight = GoalSight(0.0, 9.0, from_m, 0.2, matches, 3.5, chance, n_shown=900)
                where = {"goal": "house_1", "house": "house_1" if own else "house_2", "own": own}
                where |= {"suburb": suburb, "side": side, "from_m": from_m, "share": 1.0}
                rows.append({**where, **asdict(sight)})
    return pd.DataFrame(rows)


def test_figures_are_those_of_the_table() -> None:
    """It is likely from three sides, sure at once from one; from near nothing is seen of it."""
    found = summarise(pd.concat([looked_at([90, 9, 9, 0, 0, 0]), looked_at([9] * 6, own=False)]))
    goal, other = found["goal"], found[OTHER]
    assert (goal["goals"], goal["houses"], goal["looks"]) == (2, 2, 24)
    assert (goal["likely"], goal["sides_likely"], goal["keypoints_most"]) == (0.25, 6, 90)
    assert goal["sure"] == goal["sure_1"] == pytest.approx(1 / 3)
    assert goal["houses_sure"] == 2
    assert (other["sides_likely"], other["sure_3"], other["houses_sure"]) == (12, 0.0, 0)
    # of two houses that are sure from no side: their twelve sides are no independent trials
    assert other["sure_3_ci"] == pytest.approx([0.0, 1 - 0.025**0.5])
    table = as_table(found)
    assert table["goal"]["sure"] == "0.3333"  # two suburbs alike tell no interval
    assert table[OTHER]["sure_3"].startswith("0 [0, ")


def test_sides_are_looked_at_one_after_the_other() -> None:
    near = looked_at([9, 90, 9, 9, 9, 9])
    near["from_m"] = near.from_m.map(dict(zip(RANGES_M, RANGES_M[::-1], strict=True)))
    goal = summarise(near)["goal"]  # from near it is seen, which is the look at a further side
    assert [goal[n] for n in ("sure", "sure_1", "sure_2", "sure_3")] == pytest.approx(
        np.array([1, 2, 3, 4]) / SIDES
    )


def test_where_there_is_but_one_house_there_is_no_other() -> None:
    found = summarise(looked_at([90] * 6))
    assert found[OTHER]["likely"] is None and found[OTHER]["keypoints_most"] is None
    assert json.loads(json.dumps(found, allow_nan=False))[OTHER]["houses"] == 0


def test_where_no_goal_is_seen_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(goal_sights, "_rows", lambda *asked: [])
    with pytest.raises(MissionError, match="take more suburbs or goals"):
        evaluate(scenes_of(SUBURB), 1, 1, seed=3000, folder=tmp_path)


@pytest.mark.slow
def test_a_goal_is_known_and_no_other_house_is_taken_for_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = tmp_path / "small.yaml"
    few = SUBURB.read_text().replace("count: 32", "count: 7")
    small.write_text(few.replace("mailboxes: 26", "mailboxes: 2"))
    command = ["evaluate", "goals", str(small), "--suburbs", "1", "--goals", "1", "--json"]
    app([*command, "-o", str(tmp_path)], standalone_mode=False)
    found = json.loads(capsys.readouterr().out)
    assert found["goal"]["goals"] == 1 and found[OTHER]["houses"] > 3
    assert found["goal"]["keypoints_most"] > 2 * found[OTHER]["keypoints_most"]
    assert found["goal"]["houses_sure"] == 1 and found[OTHER]["houses_sure"] == 0
    app([*command, "-o", str(tmp_path)], standalone_mode=False)  # what is there is read
    assert json.loads(capsys.readouterr().out) == found
    one = replace(
        scenes_of(small), varied=False
    )  # a world that stays as it is, however often asked
    rows = evaluate(one, 3, 1, seed=3000, folder=tmp_path)
    assert set(rows.suburb) == {0} and len(rows) == found["goal"]["looks"] + found[OTHER]["looks"]
