"""What a mission is driven on: a robot's body, the settings, decisions as they are logged."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from vrchain.robot import Drive, Observation

GOAL_RANGE_M = (6.0, 15.0)  # from which a goal's pictures are taken, in suburbs
_BEFORE = "~"


class Body(Protocol):
    """What a mission needs of a robot: its senses and its wheels."""

    def observe(self, look: bool = False, towards_rad: float | None = None) -> Observation:
        """What it senses now, with a panorama if it looks, or one camera's view."""

    def drive(self, command: Drive, duration_s: float) -> None:
        """Drive so for a while."""


@dataclass(frozen=True)
class MissionConfig:
    """How a mission is driven."""

    approach_m: float = 3.0  # a landmark is reached at this range, so that it hides no other
    arrival_m: float = 1.5  # the goal is reached at this range
    glance_every_m: float = 2.5  # of way: a view of what is driven to
    look_every_m: float = 12.0  # of way: a look around,
    search_every_m: float = 8.0  # and where no route is known
    sees_m: float = 35.0  # from farther away a glance at the goal tells nothing
    tick_s: float = 0.3  # between two steering commands
    # To claim arrival: chance of a sight, log-likelihood ratio of its looks, and keypoints beyond
    # those by chance; fewer keypoints in one that looks like nothing else. Houses of its make that
    # were met had at most 23 and looks of 2.8, 18 and 3.3, 16 and 2.7, 9 and 2.8, 5 and 3.5.
    sure_chance: float = 0.8
    sure_looks: float = 2.6
    sure_matches: int = 36
    surest_looks: float = 3.2
    surest_matches: int = 24
    least_matches: int = 8  # of a plain goal, whose pictures show few
    # Of a sight from which nothing else is tried first; of 54 with 0.5 to 0.7, in suburbs of seeds
    # 10046 and 10047, 12 were right.
    likely: float = 0.7
    least_chance: float = 0.1  # of a sight that is kept in mind
    least_trust: float = 0.3  # of a route that is worth driving: on its way it looks around too
    explores: bool = True  # whether it goes and looks elsewhere where no route leads on
    explore_m: float = 26.0  # from all places where it has looked around
    reputation: bool = True  # whether a robot's word of its way counts less when others deny it
    lasting_s: float = 3600.0  # a view this old leaves 1/e of the chance that it still holds
    chance_per_m: float = 0.012  # of finding the goal by exploring: a detour is to be worth more
    stuck_after_s: float = 15.0  # without half a metre of headway
    leg_limit_s: float = 30.0  # for one approach, beside the way; what takes longer leads astray
    limit_s: float = 600.0
    max_looks: int = 200


@dataclass(frozen=True)
class Decision:
    """One line of the log. look: index of the panorama it rested on, in ``MissionResult.looks``."""

    time_s: float
    what: str
    why: str
    look: int | None = None
    values: Mapping[str, Any] = field(default_factory=dict)


class GaveUp(Exception):
    """Ends a mission; the text is the reason."""


@dataclass(frozen=True)
class Published:
    """A panorama in the ledger with its landmarks, by their digests, and when it was published."""

    digest: bytes
    time_ns: int = 0


class Log(Protocol):
    """Takes down a decision, now."""

    def __call__(self, what: str, why: str, look: int | None = None, **values: Any) -> None:
        """Fields of ``Decision``."""


def panorama_name(robot: str, k: int) -> str:
    """What a robot's panorama is called, the newest or the k-th before it, as git has it."""
    return f"{robot}{_BEFORE}{k}" if k else robot


def robot_of(panorama: str) -> str:
    """Whose panorama has such a name."""
    return panorama.partition(_BEFORE)[0]


def age_of(panorama: str) -> int:
    """How many a robot has published since one of such a name."""
    return int(panorama.partition(_BEFORE)[2] or 0)
