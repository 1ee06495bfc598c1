"""How often, and how directly, robots arrive: missions with the ledger, alone, and by truth.

Every mission is driven by each arm: *ledger* plans from what the others have published, and goes
and looks elsewhere where no chain leads on; *alone* has the same senses, recognition and time, but
no ledger, so that it only looks elsewhere; *oracle* is ledger with landmarks as truth has them. The
other robots publish what they see from where they are put, have driven about and published for some
minutes when the mission starts, and go on while it runs. To ``alone`` they are of no use and stay
where they are.

A hundred missions are ten in each of ten suburbs, the first ten one in each: even few missions say
something of how suburbs differ. Each is saved as it ends, so that a run broken off, or asked for
more missions, goes on with the next. Broadcasting every panorama to everyone would lead to the same
decisions, and differs in bytes alone: they are counted.

A mission succeeds where the robot says that it arrived, and truth has it at the goal
(docs/reference/definitions.md). ``summarise`` counts them by arm, ``as_table`` makes a table of it.
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from vrchain.errors import MissionError
from vrchain.experiments.intervals import Bootstrap, ratio, table_of
from vrchain.experiments.kept import folder_of, kept
from vrchain.experiments.missions.draw import Mission
from vrchain.experiments.missions.drive import Conditions, Suburb
from vrchain.experiments.missions.liars import FORGED
from vrchain.experiments.scenes import Scenes
from vrchain.experiments.workers import each
from vrchain.files import name_of
from vrchain.landmarks.extraction.record import maker_of
from vrchain.panorama import CameraRig
from vrchain.simulation.task import robot_names

ARMS = ("ledger", "alone", "oracle")
SUBURBS = 10  # of a hundred missions
SOON_S = (150, 300)
MEANS = (
    "replans", "legs", "to_landmarks", "barred", "published", "ledger_mb", "broadcast_mb",
    "seconds_simulated", "seconds_looking", "wall_s",
)  # fmt: skip
_TRUST = (0.0, 0.5, 0.8, 0.95, 1.0)  # in routes: between two of these they are counted together


def evaluate(
    scenes: Scenes,
    n_missions: int,
    n_robots: int,
    arms: Sequence[str] = ARMS,
    *,
    seed: int,
    folder: Path,
    rig: CameraRig | None = None,
    to_places: bool = False,
    landmarks: int = 0,
    conditions: Conditions | None = None,
    jobs: int | None = 1,
) -> tuple[pd.DataFrame, list[Mission]]:
    """One row a mission and arm, and the missions as they were drawn, to objects or to places.

    landmarks: how many each chain needs at least; if 0, every third needs two. jobs: see
    ``workers.each``. What was found already under ``folder`` is read from there.
    """
    arms = list(dict.fromkeys(arms))
    robot_names(n_robots)  # refused before a scene is built
    if landmarks < 0:
        raise MissionError(f"expected chains of 0 landmarks or more, got {landmarks}")
    if n_missions < 1 or not arms or not set(arms) <= set(ARMS):
        raise MissionError(
            f"expected 1 mission or more and arms of {', '.join(ARMS)}, got {n_missions} and "
            f"{', '.join(arms)}"
        )
    rig, conditions = rig or CameraRig(), conditions or Conditions()
    if conditions.liars >= n_robots:
        raise MissionError(
            f"expected fewer liars than the {n_robots} robots: one drives, got {conditions.liars}"
        )
    if conditions.liars and "oracle" in arms and conditions.lie in FORGED:
        raise MissionError(
            "expected no arm oracle: it knows from where panoramas were taken, and so sees through "
            f"--lie {conditions.lie}; give --arms ledger --arms alone"
        )
    scenes.at(conditions.season, conditions.time)  # refused before anything is driven, as is
    conditions.goal_rig(rig)
    drawn = folder_of(folder, scenes, n_robots, seed, asdict(rig), to_places, landmarks)
    driven = drawn / name_of([drawn.name, asdict(conditions), maker_of()])
    asked = _Evaluation(
        scenes, n_robots, arms, seed, rig, to_places, landmarks, conditions, drawn, driven
    )
    left = [number for number in range(n_missions) if not asked.is_done(number)]
    left.sort(key=asked.k)  # a suburb is built once
    each(asked.drive, left, jobs, "missions")
    _suburb.cache_clear()
    rows = []
    for number, arm in product(range(n_missions), arms):
        row = json.loads(asked.row_file(number, arm).read_text())
        log = row.pop("log")
        row["routes"], row["seconds_looking"] = routes_of(log, row["success"]), looking_s(log)
        rows.append({"suburb": asked.k(number) if scenes.varied else number, **row})
    return pd.DataFrame(rows), [asked.mission(number) for number in range(n_missions)]


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """What is asked of every mission; drawn, driven: where it and what came of it are kept."""

    scenes: Scenes
    n_robots: int
    arms: Sequence[str]
    seed: int
    rig: CameraRig
    to_places: bool
    landmarks: int
    conditions: Conditions
    drawn: Path
    driven: Path

    def k(self, number: int) -> int:
        """The suburb of a mission."""
        hundred, within = divmod(number, SUBURBS**2)
        return hundred * SUBURBS + within % SUBURBS

    def row_file(self, number: int, arm: str) -> Path:
        return self.driven / f"mission_{number:04d}_{arm}.json"

    def is_done(self, number: int) -> bool:
        """Whether a mission was driven by each arm: no process is started for it."""
        return all(self.row_file(number, arm).exists() for arm in self.arms)

    def mission(self, number: int) -> Mission:
        """The mission, drawn if it was not before."""
        k = self.k(number)
        asked = self.seed, k, number, self.n_robots, self.to_places, self.landmarks
        file = self.drawn / f"mission_{number:04d}.json"
        return Mission.from_dict(kept(file, lambda: self._suburb(k).ground.draw(*asked).as_dict()))

    def drive(self, number: int) -> None:
        """Draw a mission and drive it by each arm, as far as that was not done before."""
        mission = self.mission(number)
        for arm in self.arms:
            kept(self.row_file(number, arm), partial(self._drive, mission, arm))

    def _drive(self, mission: Mission, arm: str) -> dict[str, object]:
        return self._suburb(self.k(mission.number)).drive(mission, arm, self.conditions)

    def _suburb(self, k: int) -> Suburb:
        """A world that stays as it is is built once."""
        return _suburb(self.scenes, self.seed, k if self.scenes.varied else 0, self.rig)


@lru_cache(maxsize=1)
def _suburb(scenes: Scenes, seed: int, k: int, rig: CameraRig) -> Suburb:
    """The one at work."""
    return Suburb(scenes, seed, k, rig)


def routes_of(log: Sequence[Mapping[str, Any]], success: bool) -> list[tuple[float, bool]]:
    """Of each route that was driven the trust in it, and whether it led a mission to success.

    At its end, or where the goal came into view on the way. Routes that replaced it on the way are
    not counted by themselves.
    """
    found: list[tuple[float, bool]] = []
    trust, driven = None, False
    for decision in log:
        what = decision["what"]
        if what == "route" and trust is None:
            trust, driven = decision["values"]["trust"], False
        elif what in ("leg", "approach"):
            driven = True
        elif what in ("plan again", "arrived", "gave up") and trust is not None:
            found += [(trust, success and what == "arrived")] if driven else []
            trust = None
    return found


def looking_s(log: Sequence[Mapping[str, Any]]) -> float:
    """For how long a robot drove about to look, since no route was worth driving."""
    spent = (
        float(after["time_s"] - before["time_s"])
        for before, after in pairwise(log)
        if before["what"] in ("no route", "explore")
    )
    return sum(spent, 0.0)


def summarise(table: pd.DataFrame, missions: Sequence[Mission]) -> dict[str, dict[str, object]]:
    """The figures of each arm, with 95 % intervals under NAME_ci: bootstrap over suburbs.

    success, also within 150 and 300 s, and spl over all n missions; success_given_chain and
    spl_chain over the n_with_chain that a chain leads through; false_arrivals and collisions are
    counts; ``MEANS`` are means, what a mission sends by the ledger and by broadcast among them;
    wall_s_per_300_s is what five simulated minutes cost, the patrol's among them. Of ledger,
    times_alone: its successes over those of alone. Also how many missions need how many landmarks,
    and how many draws were rejected for what; and of routes driven, by the trust in them, how many
    led there.
    """
    told = Bootstrap(table.suburb, "navigation")
    rejected = sum((Counter(m.rejected) for m in missions), Counter[str]())
    found: dict[str, dict[str, object]] = {}
    successes = {}
    for arm, own in table.groupby("arm", sort=False):
        successes[str(arm)] = told.sums(own.success, own.suburb)
        found[str(arm)] = {
            **_summary(own, told),
            "routes": _routes(own),
            "chain_lengths": {str(n): k for n, k in sorted(Counter(own.chain.tolist()).items())},
            "rejected_draws": dict(rejected),
        }
    if {"ledger", "alone"} <= found.keys():
        both = successes["ledger"], successes["alone"]
        found["ledger"] |= ratio("times_alone", *both, told.again)
    return found


def _summary(own: pd.DataFrame, told: Bootstrap) -> dict[str, object]:
    success, chained = own.success.astype(float), own[own.chain > 0]
    spl: pd.Series = success * own.way_m / np.maximum(own.driven_m, own.way_m)
    chain_way_m = chained.chain_way_m.astype(float)
    spl_chain: pd.Series = (
        success[chained.index] * chain_way_m / np.maximum(chained.driven_m, chain_way_m)
    )
    found: dict[str, object] = {
        "n": len(own),
        "n_with_chain": len(chained),
        **told.share("success", success, own.suburb),
    }
    for s in SOON_S:
        soon = success * (own.seconds_simulated <= s)
        found |= told.share(f"success_{s}_s", soon, own.suburb)
    found |= told.share("success_given_chain", chained.success, chained.suburb)
    found |= told.mean("spl", spl, own.suburb, 1.0)
    found |= told.mean("spl_chain", spl_chain, chained.suburb, 1.0)
    found["false_arrivals"] = int((own.arrived.astype(bool) & ~own.success.astype(bool)).sum())
    found["collisions"] = int(own.collisions.sum())
    for name in MEANS:
        found[name] = float(own[name].mean())
    found["wall_s_per_300_s"] = float(300 * own.wall_s.sum() / own.clock_s.sum())
    return found


def _routes(own: pd.DataFrame) -> list[dict[str, object]]:
    """How many routes were driven on how much trust, and the share that led there."""
    driven = np.array([route for routes in own.routes for route in routes]).reshape(-1, 2)
    found: list[dict[str, object]] = []
    for low, high in pairwise(_TRUST):
        within = (driven[:, 0] > low) & (driven[:, 0] <= high)
        share = float(driven[within, 1].mean()) if within.any() else None
        found.append({"trust": [low, high], "n": int(within.sum()), "led_there": share})
    return found


def as_table(summary: Mapping[str, Mapping[str, object]]) -> pd.DataFrame:
    """The figures to read: one row an arm, intervals in brackets."""
    names = (
        "n", "n_with_chain", "success", *(f"success_{s}_s" for s in SOON_S),
        "success_given_chain", "times_alone", "spl", "spl_chain",
        "false_arrivals", "collisions", *MEANS, "wall_s_per_300_s",
    )  # fmt: skip
    return table_of(summary, names, "arm", ".2f")


def routes_table(summary: Mapping[str, Mapping[str, Any]]) -> pd.DataFrame:
    """How many routes each arm drove on how much trust, and the share that led there."""
    rows = [
        {"arm": arm, "trust": "{:g} - {:g}".format(*r["trust"]), "n": r["n"], "led": r["led_there"]}
        for arm, figures in summary.items()
        for r in figures["routes"]
        if r["n"]
    ]
    return pd.DataFrame(rows, columns=["arm", "trust", "n", "led"]).round(2)


def as_text(summary: Mapping[str, Mapping[str, Any]]) -> str:
    """All of the summary to read."""
    first = next(iter(summary.values()))
    return (
        f"landmarks in the shortest chain, and missions: {first['chain_lengths']}\n"
        f"rejected draws: {first['rejected_draws']}\n{as_table(summary).T.to_string()}\n\n"
        "routes driven, by the trust in them, and how many led to the goal\n"
        f"{routes_table(summary).to_string(index=False, na_rep='-')}"
    )
