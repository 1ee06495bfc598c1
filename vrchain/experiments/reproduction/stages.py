"""The paper's evaluation, stage by stage, from the suburb to the numbers of its table.

Each stage writes one folder, ``build/PROFILE/STAGE``, whole or not at all.
"""

import json
import pickle
import tempfile
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import pandas as pd

from vrchain.experiments.landmarks import over_distance as landmark_bands
from vrchain.experiments.landmarks import pairs as landmarks
from vrchain.experiments.landmarks.precision import summarise_survey
from vrchain.experiments.ledger import cluster, latency
from vrchain.experiments.reproduction.results import (
    MARKER,
    ROBOTS,
    SCENE,
    Profile,
    ReproductionError,
    Results,
    rig_text,
    suburb,
)
from vrchain.experiments.scenes import suburbs
from vrchain.experiments.workers import each
from vrchain.extras import require
from vrchain.files import output_folder
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.sift import extract
from vrchain.landmarks.matching.common import compare
from vrchain.ledger import Ledger
from vrchain.ledger.cluster.servers import can_serve
from vrchain.navigation.settings import MissionConfig
from vrchain.panorama import Panorama
from vrchain.simulation import mission, survey
from vrchain.world import load_spec
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

_TEAM_M = (2.0, 20.0)  # between R1 and R2, for a common landmark to be sought

Stage = Callable[[Results, Path], str]
"""Writes a stage's results into a folder; says in a line what it did."""
Draw = Callable[[mission.MissionRun, Path], object]
"""Adds pictures of a mission to its folder."""


def run_survey(results: Results, folder: Path) -> str:
    """R1 and R2 wander and publish until the largest number of positions is in the ledger."""
    profile = results.profile
    found = survey.survey(
        suburb(), folder / "ledger", max(profile.positions), seed=profile.seed, rig=profile.rig
    )
    _write(folder, survey=found)
    rules = ", ".join(f"{rule} {n}" for rule, n in found.rule.value_counts().items())
    return f"{len(found)} positions of R1 and R2 with {rig_text(profile.rig)}; rules: {rules}"


def run_update(results: Results, folder: Path) -> str:
    """Update time over each number of positions, in a new ledger for each; then over servers."""
    _, payloads = _surveyed(results)
    means = []
    for n in results.profile.positions:
        found = latency.update_latency(
            payloads[:n], folder / f"ledger_{n}", ROBOTS, results.profile.seed
        )
        found.insert(0, "ledger_position", np.arange(1, n + 1))
        _write(folder, **{f"update_{n}": found})
        means.append(f"{found.total_us.mean() / 1e3:.2f} ms over {n}")
    said = f"mean update {', '.join(means)} positions"
    if not can_serve():
        return f"{said}; over servers not measured: the extra cluster is not installed"
    n = results.profile.positions[0]
    over = cluster.update_over_servers(payloads[:n], seed=results.profile.seed)
    _write(folder, update_servers=over)
    return f"{said}; {over.total_us.mean() / 1e3:.0f} ms over servers"


def run_retrieval(results: Results, folder: Path) -> str:
    """Retrieval three ways from the ledgers of the updates; throughput; what vision takes."""
    profile = results.profile
    tables = []
    for n in profile.positions:
        with Ledger.open(results.path("update", f"ledger_{n}")) as ledger:
            table = latency.retrieval_latency(ledger, ROBOTS, common_landmark)
        table.insert(0, "ledger_positions", n)
        tables.append(table)
    found = pd.concat(tables)
    payloads = _surveyed(results)[1][: profile.positions[1]]
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        rates = latency.throughput(payloads, Path(scratch) / "ledger", ROBOTS, profile.seed)
    _write(folder, retrieval=found, throughput=rates, vision=vision_latency(profile))
    medians = found.groupby("way").time_us.median()
    times = ", ".join(
        f"{way.replace('_', ' ')} {medians[way]:.3g} us" for way in latency.RETRIEVALS
    )
    return f"{times}; {rates.updates_per_s[0]:.0f} updates a second"


def run_landmarks(results: Results, folder: Path) -> str:
    """How good common landmarks are: between R1's and R2's panoramas; over distance, by variant."""
    profile = results.profile
    surveyed, payloads = _surveyed(results)
    truth, summaries = GroundTruth(suburb()), []
    for n in profile.positions:
        looks = _looks(_team_pairs(surveyed[:n], profile.survey_pairs), surveyed, payloads)
        claims = landmarks.claims_of(looks, truth, profile.rig)
        _write(folder, **{f"survey_{n}": claims})
        summaries.append({"positions": n, **summarise_survey(claims)})
    _write(folder, survey_summary=pd.DataFrame(summaries))
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        claims, pairs = landmark_bands.over_distance(
            suburbs(load_spec(SCENE)), profile.pairs_a_band, profile.bands_m,
            seed=profile.seed, folder=Path(scratch), rig=profile.fine_rig, jobs=None,
        )  # fmt: skip
    found = landmark_bands.by_band(claims, pairs)
    _write(folder, pairs=claims, pairs_drawn=pairs, pairs_summary=found)
    shown = "; ".join(
        f"{variant} {_listed(rows.precision)} and {_listed(rows.recall)}"
        for variant, rows in found.groupby("variant", sort=False)
    )
    bands = ", ".join(found.band_m.unique())
    return f"precision and recall {bands} m apart, {profile.pairs_a_band} pairs each: {shown}"


def _write(folder: Path, **tables: pd.DataFrame) -> None:
    """Each as a CSV of its name."""
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)


def _listed(shares: pd.Series) -> str:
    return " ".join("-" if np.isnan(share) else f"{share:.2f}" for share in shares)


def run_mission(results: Results, folder: Path, draw: Draw | None = None) -> str:
    """Some missions; ``draw`` may add pictures of each to its folder.

    All outcomes are in missions.csv. Pictures elsewhere show the first that truly arrived, of those
    the first that drove a chain, if one did.
    """
    profile = results.profile
    seeds = range(profile.seed, profile.seed + profile.missions)
    runs = each(partial(_mission, profile, folder, draw), seeds, None, "missions")
    outcomes = pd.DataFrame([{"seed": s, **r.summary()} for s, r in zip(seeds, runs, strict=True)])
    _write(folder, missions=outcomes)
    shown = max(runs, key=lambda r: (r.success, bool(r.result.plans)))  # the first of equals
    with open(folder / "run.pickle", "wb") as file:
        pickle.dump(shown, file)
    false = int((outcomes.arrived & ~outcomes.success).sum())
    return f"{outcomes.success.sum()} of {len(runs)} arrived, {false} false arrivals"


def _mission(profile: Profile, folder: Path, draw: Draw | None, seed: int) -> mission.MissionRun:
    """One mission in a folder of its own; the scene, which is large, is left out."""
    own = folder / f"seed_{seed}"
    own.mkdir()
    config = MissionConfig(limit_s=profile.mission_s)
    run = mission.run_mission(
        suburb(), own / "ledger", seed=seed, rig=profile.mission_rig, config=config
    )
    mission.save_log(run, own)
    if draw:
        draw(run, own)
    return replace(run, scene=None)  # type: ignore[arg-type]


STAGES: dict[str, Stage] = {
    "survey": run_survey,
    "update": run_update,
    "retrieval": run_retrieval,
    "landmarks": run_landmarks,
    "mission": run_mission,
}
AT_ONCE = ("survey", "mission")  # neither needs the other's results, or measures times
NEEDS = {
    "update": ("survey",),
    "retrieval": ("survey", "update"),
    "landmarks": ("survey",),
    "figures": tuple(STAGES),
    "notebooks": tuple(STAGES),
}
LIBRARIES = {
    "landmarks": ("torch",),
    "mission": ("torch",),
    "figures": ("torch",),
    "notebooks": ("torch", "nbconvert", "ipykernel", "nats"),
}


def reproduce(
    results: Results,
    names: Sequence[str] = (),
    stages: dict[str, Stage] = STAGES,
    tell: Callable[[str], object] = print,
    jobs: int | None = 1,
    resume: bool = False,
) -> None:
    """Run the named stages (all, if none is named) in their order, telling of each in one line.

    resume: those that are finished, by the same code and by what they need, are kept.

    Results that a stage goes on from are taken as they are; it is told if other code made them.
    jobs: processes for stages that can run at once, see ``workers.each``.
    ReproductionError, before anything is run, if there is no such stage, if a library that a stage
    needs is not installed, or if what it needs is neither there nor about to be made.
    """
    for name in names:
        if name not in stages:
            raise ReproductionError(f"expected stages of {', '.join(stages)}, got {name!r}")
    chosen = [stage for stage in stages if stage in names or not names]
    chosen = _unfinished(results, chosen) if resume else chosen
    needed = {n for stage in chosen for n in NEEDS.get(stage, ())} - set(chosen)
    missing = {n for n in needed if not results.has(n)}
    if missing:
        wanted = [stage for stage in stages if stage in missing or stage in chosen]
        raise ReproductionError(
            f"{', '.join(chosen)} cannot do without the results of {', '.join(sorted(missing))}: "
            f"run `vrchain reproduce --profile {results.profile.name} --only {' '.join(wanted)}`"
        )
    for stage in chosen:
        require(*LIBRARIES.get(stage, ()), what=f"the stage {stage}", error=ReproductionError)
    tell_of_other_code(results, [stage for stage in stages if stage in needed], tell)
    groups = [[stage] for stage in chosen if stage not in AT_ONCE]
    if at_once := [stage for stage in chosen if stage in AT_ONCE]:
        groups.insert(0, at_once)
    said: dict[str, str] = {}
    for group in groups:
        with ExitStack() as opened:  # here, so that a process that is ended leaves nothing
            folders = [
                opened.enter_context(output_folder(results.folder / stage, MARKER))
                for stage in group
            ]
            work = partial(_run, results, [stages[stage] for stage in group], folders)
            lines = each(work, range(len(group)), jobs, "stages")
            for stage, folder, line in zip(group, folders, lines, strict=True):
                (folder / MARKER).write_text(results.marker(stage))
                said[stage] = f"{stage:10} {line}"
        while chosen and chosen[0] in said:
            tell(said[chosen.pop(0)])


def _unfinished(results: Results, chosen: Sequence[str]) -> list[str]:
    """Those of some stages that have no results of this code, or that need one of these."""
    left: list[str] = []
    for stage in chosen:
        old = not results.has(stage) or results.by_other_code([stage])
        if old or {*NEEDS.get(stage, ())} & {*left}:
            left.append(stage)
    return left


def _run(results: Results, stages: Sequence[Stage], folders: Sequence[Path], number: int) -> str:
    start = perf_counter()
    said = stages[number](results, folders[number])
    return f"{said} ({perf_counter() - start:.1f} s)"


def tell_of_other_code(
    results: Results, stages: Iterable[str] = STAGES, tell: Callable[[str], object] = print
) -> None:
    """In a line, if there are results of some stages that other code made, which are taken."""
    if old := results.by_other_code(stages):
        tell(f"taken as they are, though the code has changed since: results of {', '.join(old)}")


def common_landmark(own: bytes, other: bytes) -> object:
    """The surest common landmark of two encoded panoramas, None if there is none."""
    a, b = Panorama.decode(own), Panorama.decode(other)
    found = compare(extract(a), extract(b), a.rig).common
    return found[0] if found else None


def vision_latency(profile: Profile) -> pd.DataFrame:
    """What is no part of an update: drawing, coding, and comparing panoramas.

    One row per (step, rig): step, rig, n_samples, median_ms, mean_ms.
    """
    rows = []
    renderer = Renderer(suburb())
    rigs = {rig_text(rig): rig for rig in (profile.rig, profile.fine_rig)}
    for text, rig in rigs.items():
        times: dict[str, list[float]] = {}
        samples, seed = profile.vision_samples, profile.seed
        for poses in landmarks.draw_pairs(suburb(), samples, (5.0, 10.0), seed):
            a, b = (_timed(times, "render", renderer.render, pose, rig) for pose in poses)
            blob = _timed(times, "encode", a.encode)
            _timed(times, "decode", Panorama.decode, blob)
            features = [_timed(times, "extract", extract, panorama) for panorama in (a, b)]
            _timed(times, "compare", compare, *features, rig)
        for step, ms in times.items():
            measured = {"median_ms": np.median(ms), "mean_ms": np.mean(ms)}
            rows.append({"step": step, "rig": text, "n_samples": len(ms), **measured})
    return pd.DataFrame(rows)


def _timed(times: dict[str, list[float]], step: str, call: Callable[..., Any], *given: Any) -> Any:
    start = perf_counter()
    answer = call(*given)
    times.setdefault(step, []).append((perf_counter() - start) * 1e3)
    return answer


def _surveyed(results: Results) -> tuple[pd.DataFrame, list[bytes]]:
    """The survey's rows and payloads, R1's and R2's in turn."""
    found = results.table("survey", "survey")
    turn = found.groupby("robot").cumcount()
    found = found.assign(turn=turn).sort_values(["turn", "robot"], ignore_index=True)
    with Ledger.open(results.path("survey", "ledger")) as ledger:
        payloads = [ledger.payload(bytes.fromhex(digest)) for digest in found.digest]
    return found, payloads


def _team_pairs(surveyed: pd.DataFrame, most: int) -> list[tuple[int, int]]:
    """Rows of R1's positions, each with R2's nearest that is so far from it; thinned."""
    first, second = (surveyed[surveyed.robot == robot] for robot in ROBOTS)
    places = [rows[["x_m", "y_m"]].to_numpy() for rows in (first, second)]
    apart_m = np.linalg.norm(places[0][:, None] - places[1][None], axis=2)
    apart_m[apart_m < _TEAM_M[0]] = np.inf
    pairs = [
        (int(first.index[i]), int(second.index[row.argmin()]))
        for i, row in enumerate(apart_m)
        if row.min() <= _TEAM_M[1]
    ]
    kept = np.linspace(0, len(pairs) - 1, min(most, len(pairs))).round().astype(int)
    return [pairs[k] for k in kept]


def _looks(
    pairs: Iterable[tuple[int, int]], surveyed: pd.DataFrame, payloads: Sequence[bytes]
) -> Iterable[tuple[landmarks.Look, landmarks.Look]]:
    """The looks of pairs of the survey's rows."""

    def look(row: int) -> landmarks.Look:
        pose = Pose(*surveyed.loc[row, ["x_m", "y_m", "yaw_rad"]].astype(float))
        others = {name: Pose(*p) for name, p in json.loads(surveyed.others[row]).items()}
        return landmarks.Look(pose, extract(Panorama.decode(payloads[row])), others)

    for a, b in pairs:
        yield look(a), look(b)
