"""What a reproduction is made with and what came of it: profiles, and the results on disk.

*Positions* are always those in the ledger, of R1 and R2 together: at 40 positions each robot has
published 20 times.
"""

import json
import os
import pickle
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path

import pandas as pd

from vrchain.errors import VRChainError
from vrchain.experiments.reproduction import paper
from vrchain.files import code_digest
from vrchain.panorama import CameraRig
from vrchain.paths import BUILD, SCENES
from vrchain.simulation import mission
from vrchain.world import load_scene
from vrchain.world.model import Scene

ROBOTS = ("R1", "R2")
SCENE = SCENES / "suburb.yaml"
MARKER = "stage.json"


class ReproductionError(VRChainError):
    """No such profile or stage, or the results that a stage goes on from are missing."""


class NotRunError(ReproductionError):
    """There are no results of a stage."""

    def __init__(self, told: str, stage: str) -> None:
        super().__init__(told)
        self.stage = stage


@dataclass(frozen=True)
class Profile:
    """How large a reproduction is."""

    name: str
    rig: CameraRig  # of the robots that survey the suburb
    fine_rig: CameraRig = field(default_factory=CameraRig)  # of random pairs of places
    mission_rig: CameraRig = field(default_factory=CameraRig)
    seed: int = 10_000
    positions: tuple[int, ...] = (40, 200, 500)
    missions: int = 1
    mission_s: float = 600.0  # simulated, for one at most
    pairs_a_band: int = 10  # random pairs of places
    bands_m: tuple[tuple[float, float], ...] = ((1.0, 10.0), (10.0, 20.0), (20.0, 40.0))
    survey_pairs: int = 12  # at most, of R1's and R2's panoramas, for each number of positions
    vision_samples: int = 5


_SMALL = CameraRig(width_px=320, height_px=240)
_TINY = CameraRig(width_px=160, height_px=120)
_ALL = (
    Profile("quick", _SMALL, missions=2),
    Profile("paper", CameraRig(), missions=5, pairs_a_band=60, survey_pairs=60, vision_samples=20),
    Profile(
        "smoke", _TINY, fine_rig=_SMALL, mission_rig=_TINY, seed=3_000, positions=(4, 8, 12),
        mission_s=60.0, pairs_a_band=2, bands_m=((1.0, 10.0),), survey_pairs=2, vision_samples=1,
    ),
)  # fmt: skip
PROFILES = {profile.name: profile for profile in _ALL}
ADVERTISED = ("quick", "paper")  # smoke is for the project's own tests


def profile_named(name: str) -> Profile:
    """A profile by its name; ReproductionError if there is none."""
    if name not in PROFILES:
        raise ReproductionError(f"expected a profile of {', '.join(ADVERTISED)}, got {name!r}")
    return PROFILES[name]


@dataclass(frozen=True)
class Results:
    """The results of a profile, below the folder ``build``.

    code: what the package was as they were opened, which is what makes them.
    """

    profile: Profile
    build: Path = BUILD
    code: str = field(default_factory=code_digest)

    @classmethod
    def here(cls, profile: str | None = None) -> "Results":
        """Those of a profile where the environment says they are.

        VRCHAIN_PROFILE names the profile if none is given, for figures' scripts and notebooks.
        """
        return cls(profile_named(profile or os.environ.get("VRCHAIN_PROFILE", "quick")))

    @property
    def folder(self) -> Path:
        """Where its stages' folders are."""
        return self.build / self.profile.name

    def has(self, stage: str) -> bool:
        """Whether a stage's results are there, made with the profile as it is now."""
        profile = json.loads(json.dumps(asdict(self.profile)))  # as a marker file has it
        return self._made(stage).get("profile") == profile

    def by_other_code(self, stages: Iterable[str]) -> list[str]:
        """Those of some stages whose results the package made as it was before a change.

        Pictures and commands make none: see ``files.code_digest``.
        """
        there = filter(self.has, stages)
        return [stage for stage in there if self._made(stage).get("code") != self.code]

    def marker(self, stage: str) -> str:
        """The content of a finished stage's marker file."""
        made = {"stage": stage, "profile": asdict(self.profile), "code": self.code}
        return json.dumps(made, indent=2) + "\n"

    def _made(self, stage: str) -> dict[str, object]:
        """What a stage's marker file says; nothing if there is none, or none that can be read."""
        try:
            made = json.loads((self.folder / stage / MARKER).read_text())
        except (OSError, ValueError):
            return {}
        return made if isinstance(made, dict) else {}

    def path(self, stage: str, name: str) -> Path:
        """A file or folder of a stage; NotRunError if the stage has not been run."""
        if not self.has(stage):
            raise NotRunError(
                f"{self.folder / stage} holds no results of this version: "
                f"run `vrchain reproduce --profile {self.profile.name} --only {stage}` first",
                stage,
            )
        return self.folder / stage / name

    def table(self, stage: str, name: str) -> pd.DataFrame:
        """A stage's CSV; ReproductionError unless it has one of that name."""
        path = self.path(stage, f"{name}.csv")
        if not path.exists():
            there = sorted(csv.stem for csv in path.parent.glob("*.csv"))
            raise ReproductionError(
                f"expected a table of {stage}, {' or '.join(there)}, got {name!r}"
            )
        return pd.read_csv(path)

    def updates(self) -> dict[int, pd.DataFrame]:
        """``latency.update_latency`` by number of positions."""
        return {n: self.table("update", f"update_{n}") for n in self.profile.positions}

    def update_servers(self) -> pd.DataFrame | None:
        """``cluster.update_over_servers``, where it could be measured."""
        name = "update_servers"
        there = self.path("update", f"{name}.csv").exists()
        return self.table("update", name) if there else None

    def retrievals(self) -> dict[int, pd.DataFrame]:
        """``latency.retrieval_latency`` by number of positions."""
        found = self.table("retrieval", "retrieval")
        return {n: found[found.ledger_positions == n] for n in self.profile.positions}

    def qualities(self) -> pd.DataFrame:
        """Common landmarks of R1's and R2's panoramas, one row a number of positions."""
        return self.table("landmarks", "survey_summary")

    def summary(self) -> pd.DataFrame:
        """The paper's table: ``paper.summary_table``."""
        found = self.qualities()
        qualities = dict(zip(self.profile.positions, found.quality_m_mean, strict=True))
        return paper.summary_table(self.updates(), self.retrievals(), qualities)

    def bounds(self) -> pd.DataFrame:
        """The paper's bounds: ``paper.bounds_table``."""
        return paper.bounds_table(self.updates(), self.retrievals())

    def statistics(self) -> pd.DataFrame:
        """How times are spread: ``paper.statistics_table``."""
        return paper.statistics_table(self.updates(), self.retrievals(), self.profile.seed)

    def note(self) -> str:
        """What the latency figures were measured on, for their captions."""
        payload_bytes = self.table("retrieval", "throughput").payload_bytes[0]
        return (
            f"Profile {self.profile.name}: panoramas of {rig_text(self.profile.rig)}, "
            f"{payload_bytes / 1000:.0f} kB each; simulated robots, one machine."
        )

    def mission(self) -> mission.MissionRun:
        """One of the missions: the first that truly arrived, by a chain if one did so."""
        with open(self.path("mission", "run.pickle"), "rb") as file:
            run: mission.MissionRun = pickle.load(file)
        return replace(run, scene=suburb())


@cache
def suburb() -> Scene:
    """The scene of the reproduction."""
    return load_scene(SCENE)


@cache
def barn() -> Scene:
    """The scene of the paper's example."""
    return load_scene(SCENES / "barn.yaml")


def rig_text(rig: CameraRig) -> str:
    """A rig in words: 8 views of 640 x 480."""
    return f"{rig.n_views} views of {rig.width_px} x {rig.height_px}"
