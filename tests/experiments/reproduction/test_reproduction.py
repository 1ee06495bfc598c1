"""The reproduction: every stage leaves what it should, whole or not at all, and says so."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import pandas as pd
import pytest
from conftest import SAID
from worlds import ROOT

from vrchain.experiments.landmarks.over_distance import VARIANTS
from vrchain.experiments.ledger.latency import RETRIEVALS, STAGES
from vrchain.experiments.reproduction import stages as reproduction
from vrchain.experiments.reproduction.paper import OURS, TABLE
from vrchain.experiments.reproduction.results import (
    ADVERTISED,
    MARKER,
    PROFILES,
    ROBOTS,
    ReproductionError,
    Results,
    profile_named,
)
from vrchain.experiments.reproduction.stages import reproduce
from vrchain.landmarks.matching.common import common_landmarks
from vrchain.ledger import Ledger, verify
from vrchain.panorama import Panorama


@pytest.fixture(scope="module")
def results(smoke_results: Results) -> Results:
    return smoke_results


@pytest.fixture
def said(smoke_results: Results) -> list[str]:
    return (smoke_results.build / SAID).read_text(encoding="utf-8").splitlines()


def test_the_survey_is_in_its_ledger(results: Results) -> None:
    table = results.table("survey", "survey")
    folder = results.path("survey", "ledger")
    assert list(table.robot.value_counts().reindex(ROBOTS)) == [6, 6]
    assert set(table.rule) <= {"start", "distance", "view", "time"}
    assert verify(folder).ok and verify(folder).blocks == 13
    with Ledger.open(folder) as ledger:
        for row in table.itertuples():
            payload = ledger.payload(bytes.fromhex(row.digest))
            assert Panorama.decode(payload).rig == results.profile.rig
            assert len(payload) == row.payload_bytes
        newest = {robot: ledger.latest(robot) for robot in ROBOTS}
    for robot, transaction in newest.items():
        last = table[table.robot == robot].iloc[-1]
        assert transaction is not None
        assert transaction.payload_digest.hex() == last.digest
        assert transaction.timestamp_ns == round(last.time_s * 1e9)


def test_updates_publish_what_the_survey_saw_in_turn(results: Results) -> None:
    surveyed = results.table("survey", "survey")
    for n, table in results.updates().items():
        assert list(table.ledger_position) == list(range(1, n + 1))
        assert list(table.robot) == ["R1", "R2"] * (n // 2)
        assert (table[[f"{stage}_us" for stage in STAGES]] > 0).all(axis=None)
        with Ledger.open(results.path("update", f"ledger_{n}")) as ledger:
            for robot in ROBOTS:
                own = list(surveyed[surveyed.robot == robot].digest)[: n // 2]
                assert [t.payload_digest.hex() for t in ledger.history(robot)] == own


def test_retrieval_has_every_way_for_every_number_of_positions(results: Results) -> None:
    for n, table in results.retrievals().items():
        for way in RETRIEVALS:
            positions = table[table.way == way].position
            assert list(positions) == list(range(1, n + 1)) or (
                way == "common_landmark" and n > 10 and len(positions) == 10
            )
    steps = results.table("retrieval", "vision")
    assert list(steps.step) == ["render", "encode", "decode", "extract", "compare"] * 2
    assert steps.rig.nunique() == 2
    assert (steps.median_ms > 0).all()
    rates = results.table("retrieval", "throughput").iloc[0]
    assert rates.newest_transactions_per_s > rates.panoramas_per_s > rates.updates_per_s
    assert not (results.folder / "retrieval" / "ledger").exists()


def test_landmarks_count_every_pair(results: Results, said: list[str]) -> None:
    profile = results.profile
    pairs, claims, summary = (
        results.table("landmarks", name) for name in ("pairs_drawn", "pairs", "pairs_summary")
    )
    for (low_m, high_m), (band_m, rows) in zip(
        profile.bands_m, pairs.groupby("band_m", sort=False), strict=True
    ):
        assert band_m == f"{low_m:g}-{high_m:g}" and rows.spacing_m.between(low_m, high_m).all()
        assert list(rows.variant.value_counts()) == [profile.pairs_a_band] * len(VARIANTS)
    assert list(zip(summary.band_m, summary.variant, strict=True)) == [
        (band_m, variant) for band_m in pairs.band_m.unique() for variant in VARIANTS
    ]
    assert (summary.n_pairs == profile.pairs_a_band).all()
    assert set(claims.variant) == set(VARIANTS) and claims.right.any()
    (line,) = [line for line in said if line.startswith("landmarks")]
    assert all(f" {variant} " in line for variant in VARIANTS) and "precision and recall" in line
    assert {p.suffix for p in results.path("landmarks", "").iterdir()} == {".csv", ".json"}
    assert list(results.qualities().positions) == [4, 8, 12]
    assert (results.qualities().n_pairs <= results.profile.survey_pairs).all()


def test_the_mission_can_be_looked_at_again(results: Results) -> None:
    run = results.mission()
    (row,) = results.table("mission", "missions").itertuples()
    folder = results.path("mission", f"seed_{row.seed}")
    assert run.summary() == json.loads((folder / "mission.json").read_text())
    assert (row.arrived, row.success) == (run.result.arrived, run.success)
    with Ledger.open(folder / "ledger") as ledger:
        assert ledger.head.hash.hex() == run.head
    assert len(run.log()) == len(run.result.decisions) > 0


def test_the_table_is_made_of_the_measurements(results: Results) -> None:
    table = results.summary()
    ours = table[table.source == OURS]
    assert list(ours.positions) == [4, 8, 12]
    for n, mean_ms in zip(ours.positions, ours.mean_update_ms, strict=True):
        assert mean_ms == pytest.approx(results.updates()[n].total_us.mean() / 1e3)
    assert ours[[f"mean_{way}_ms" for way in RETRIEVALS]].notna().all(axis=None)
    assert set(table.positions) == {4, 8, 12, *(row.positions for row in TABLE)}
    assert (results.bounds().n == 0).all()  # smoke measures none of the paper's numbers


def test_the_spread_of_times_is_that_of_the_measurements(results: Results) -> None:
    told = results.statistics().set_index(["of", "positions"])
    for n, table in results.updates().items():
        row, ms = told.loc["update", n], table.total_us / 1e3
        assert (row.n, row.mean_ms) == (n, pytest.approx(ms.mean()))
        assert row.low_ms < row.mean_ms < row.high_ms
        assert row.p50_ms == pytest.approx(ms.median()) and row.p99_ms <= ms.max()
        assert row.p50_ms <= row.p95_ms <= row.p99_ms
    assert {*told.index.get_level_values("of")} == {"update", *RETRIEVALS}


@pytest.mark.slow
def test_two_runs_differ_in_times_and_rates_alone(results: Results, tmp_path: Path) -> None:
    again = {**os.environ, "VRCHAIN_BUILD": str(tmp_path), "PYTHONPATH": str(ROOT)}
    words = ("reproduce", "--profile", "smoke", "--only", *reproduction.STAGES)
    subprocess.run([sys.executable, "-m", "vrchain", *words], env=again, check=True)
    tables = sorted(path.relative_to(results.folder) for path in results.folder.rglob("*.csv"))
    assert len(tables) >= 10
    for name in tables:
        first, second = (pd.read_csv(f / name) for f in (results.folder, tmp_path / "smoke"))
        timed = [c for c in first if re.search(r"(^|_)(us|ms|per_s|ms_per_pair|wall_s)$", c)]
        pd.testing.assert_frame_equal(
            first.drop(columns=timed), second.drop(columns=timed), check_exact=True, obj=str(name)
        )


def test_each_stage_is_told_in_one_line(said: list[str]) -> None:
    assert [line.split()[0] for line in said] == list(reproduction.STAGES)
    assert all(line.endswith(" s)") for line in said)


def test_a_common_landmark_is_the_surest_of_two_panoramas(results: Results) -> None:
    with Ledger.open(results.path("survey", "ledger")) as ledger:
        own = [ledger.payload(t.payload_digest) for t in ledger.history("R1")][:2]
    expected = common_landmarks(*map(Panorama.decode, own))
    found = reproduction.common_landmark(*own)
    assert repr(found) == (repr(expected[0]) if expected else "None")


# How stages are run, with stages that take no time.


def write(name: str, results: Results, folder: Path) -> str:
    (folder / "result").write_text(name)
    (folder / "process").write_text(str(os.getpid()))
    return f"wrote {name}"


def failing(results: Results, folder: Path) -> str:
    (folder / "half").write_text("written")
    raise RuntimeError("broke off")


def quiet(line: str) -> None:
    pass


LIGHT = {name: partial(write, name) for name in ("survey", "update", "retrieval")}


@pytest.fixture
def empty(tmp_path: Path) -> Results:
    return Results(PROFILES["smoke"], tmp_path / "build")


def test_named_stages_are_run_in_their_order(empty: Results) -> None:
    said: list[str] = []
    reproduce(empty, ["update", "survey"], LIGHT, said.append)
    assert [line.split()[0] for line in said] == ["survey", "update"]
    assert empty.has("survey") and empty.has("update") and not empty.has("retrieval")
    assert (empty.path("update", "result")).read_text() == "update"


def test_what_is_missing_is_named_before_anything_is_run(empty: Results) -> None:
    with pytest.raises(ReproductionError, match="--only survey update retrieval`"):
        reproduce(empty, ["retrieval"], LIGHT)
    with pytest.raises(ReproductionError, match=r"results of survey: .* --only survey update`"):
        reproduce(empty, ["update"], LIGHT)
    assert not empty.build.exists()
    with pytest.raises(ReproductionError, match="--profile smoke --only update` first"):
        empty.path("update", "result")


def test_an_unknown_stage_or_profile_is_named_with_those_there_are(empty: Results) -> None:
    with pytest.raises(ReproductionError, match=r"survey, update, retrieval, got 'updates'"):
        reproduce(empty, ["survey", "updates"], LIGHT)
    assert not empty.build.exists()
    with pytest.raises(ReproductionError, match=r"a profile of quick, paper, got 'full'"):
        profile_named("full")


def test_a_stage_that_breaks_off_leaves_the_earlier_result(empty: Results) -> None:
    reproduce(empty, (), LIGHT, quiet)
    with pytest.raises(RuntimeError, match="broke off"):
        reproduce(empty, ["update"], {**LIGHT, "update": failing}, quiet)
    assert sorted(p.name for p in empty.folder.iterdir()) == ["retrieval", "survey", "update"]
    assert empty.path("update", "result").read_text() == "update"


def test_stages_run_at_once_are_told_in_their_order_and_leave_all_or_nothing(
    empty: Results,
) -> None:
    said: list[str] = []
    names = ("survey", "update", "mission")
    reproduce(empty, (), {name: partial(write, name) for name in names}, said.append, jobs=2)
    assert [line.split()[0] for line in said] == list(names)
    assert all(empty.path(name, "result").read_text() == name for name in names)
    survey, update, mission = (empty.path(name, "process").read_text() for name in names)
    assert survey != mission and str(os.getpid()) == update not in (survey, mission)
    other = Results(empty.profile, empty.build / "other")
    with pytest.raises(RuntimeError, match="broke off"):
        reproduce(other, (), {"survey": partial(write, "survey"), "mission": failing}, said.append)
    assert list(other.folder.iterdir()) == [] and len(said) == 3


def test_without_names_everything_is_made_anew(empty: Results) -> None:
    reproduce(empty, (), LIGHT, quiet)
    (empty.folder / "survey" / "stale").touch()
    reproduce(empty, (), LIGHT, quiet)
    assert sorted(p.name for p in (empty.folder / "survey").iterdir()) == [
        "process", "result", MARKER,
    ]  # fmt: skip


def test_one_that_was_broken_off_goes_on(empty: Results) -> None:
    said: list[str] = []
    with pytest.raises(RuntimeError, match="broke off"):
        reproduce(empty, (), {**LIGHT, "update": failing}, quiet)
    reproduce(empty, (), LIGHT, said.append, resume=True)
    reproduce(empty, (), LIGHT, said.append, resume=True)
    assert [line.split()[0] for line in said] == ["update", "retrieval"]
    (empty.folder / "survey" / MARKER).write_text("{}")  # what rests on it is of another, then
    reproduce(empty, ["survey", "update"], LIGHT, said.append, resume=True)
    assert [line.split()[0] for line in said[2:]] == ["survey", "update"]
    empty = replace(empty, code="another")
    reproduce(empty, ["survey"], LIGHT, said.append, resume=True)
    assert said[-1].split()[0] == "survey"


def test_results_of_other_code_are_taken_and_told_of(empty: Results) -> None:
    said: list[str] = []
    reproduce(empty, (), LIGHT, said.append)
    empty = replace(empty, code="another")
    reproduce(empty, ["update"], LIGHT, said.append)
    reproduction.tell_of_other_code(empty, tell=said.append)
    _, _, _, first, _, second = said
    assert first.endswith("changed since: results of survey")
    assert second.endswith("changed since: results of survey, retrieval")
    reproduce(empty, (), LIGHT, said.append)
    assert [line.split()[0] for line in said[6:]] == list(LIGHT)


@pytest.mark.parametrize("text", ["", "[]", '{"profile": 1}'])
def test_results_of_another_size_or_without_a_good_marker_do_not_count(
    empty: Results, text: str
) -> None:
    reproduce(empty, ["survey"], LIGHT, quiet)
    larger = Results(replace(empty.profile, positions=(4, 8, 14)), empty.build)
    assert empty.has("survey") and not larger.has("survey")
    (empty.folder / "survey" / MARKER).write_text(text)
    assert not empty.has("survey")


def test_profiles_are_as_the_paper_has_it() -> None:
    for name in ADVERTISED:
        profile = PROFILES[name]
        assert profile.positions == (40, 200, 500)
        assert profile.seed >= 10_000  # seeds for reported figures
    assert 3_000 <= PROFILES["smoke"].seed < 4_000


def test_pairs_are_each_of_r1s_positions_with_the_nearest_of_r2s() -> None:
    robots, x_m = ["R1", "R2", "R1", "R2", "R1"], [0.0, 1.0, 5.0, 12.0, 60.0]
    table = pd.DataFrame({"robot": robots, "x_m": x_m, "y_m": 0.0})
    # nearer than 2 m does not count, farther than 20 m neither
    assert reproduction._team_pairs(table, 10) == [(0, 3), (2, 1)]
    assert reproduction._team_pairs(table, 1) == [(0, 3)]
    assert reproduction._team_pairs(table[:2], 10) == []
