"""Steps of a notebook or a script, each in one call. The rest of the package does without them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from vrchain.errors import ImageError
from vrchain.experiments.reproduction.results import Results
from vrchain.experiments.reproduction.stages import STAGES, reproduce
from vrchain.geometry import Pose
from vrchain.homing import HomeVector, snapshot, step
from vrchain.landmarks.extraction.record import examine
from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.matching.common import check_comparable
from vrchain.landmarks.matching.photos import FileComparison, landmarks_of_files
from vrchain.landmarks.matching.variants import DEFAULT, Variant, variant_named
from vrchain.landmarks.quality import Verdict, judge
from vrchain.panorama import Panorama
from vrchain.panorama.databases import on_floor, opened, read_database
from vrchain.panorama.sources import Source
from vrchain.world.truth import GroundTruth

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vrchain.ledger import Entry

_ONE_OF_EACH = "expected two panoramas, or two files or folders, got one of each"


@dataclass(frozen=True, eq=False)
class CommonLandmarks(FileComparison):
    """What two pictures have in common, to be shown and judged.

    keypoints: those of two panoramas that the supports of the claims count by; else None.
    """

    keypoints: tuple[Features, Features] | None = None

    def figure(self, a: str = "A", b: str = "B") -> "Figure":
        """The two pictures, called ``a`` and ``b``, and the surest claims in both."""
        from vrchain.plots.pictures import common_landmarks_figure

        return common_landmarks_figure(self.a_rgb, self.b_rgb, self.claims, self.rig, (a, b))

    def table(self) -> pd.DataFrame:
        """One row a claim, surest first: see ``plots.pictures.claims_table``."""
        from vrchain.plots.pictures import claims_table

        return claims_table(self.claims)

    def judged(self, truth: GroundTruth, poses: tuple[Pose, Pose]) -> pd.DataFrame:
        """What truth says of each claim: the fields of ``landmarks.quality.Verdict``, a row each.

        poses: from which the two panoramas were taken. Without claims the columns stay.
        ImageError for photographs.
        """
        if self.rig is None or self.keypoints is None:
            raise ImageError("expected panoramas of a scene, got photographs: no truth is known")
        verdicts = judge(self.comparison, truth, poses, self.keypoints, self.rig)
        types = {field.name: field.type for field in fields(Verdict)}
        return pd.DataFrame(verdicts, columns=list(types)).astype(types)


def common_landmarks(
    a: Panorama | str | Path, b: Panorama | str | Path, variant: str | Variant = DEFAULT
) -> CommonLandmarks:
    """The common landmarks of two panoramas, or of two photographs.

    Each is a panorama, a folder that one was saved to, or the file of a photograph. variant: of
    panoramas, its name or itself, see ``variants.variant_named``. ImageError names a picture that
    cannot serve; MissionError: there is no such variant.
    """
    left, right = _opened(a), _opened(b)
    if isinstance(left, Panorama) and isinstance(right, Panorama):
        chosen = variant_named(variant)
        check_comparable(left, right)
        looks = chosen.look(left), chosen.look(right)
        keypoints = chosen.keypoints(looks[0]), chosen.keypoints(looks[1])
        pictures = left.cylinder, right.cylinder
        return CommonLandmarks(chosen.compare(*looks), *pictures, left.rig, keypoints)
    if isinstance(a, Panorama) or isinstance(b, Panorama):
        raise ImageError(_ONE_OF_EACH)
    found = landmarks_of_files(a, b, variant)
    return CommonLandmarks(found.comparison, found.a_rgb, found.b_rgb, found.rig)


def why(a: Panorama | str | Path, b: Panorama | str | Path) -> pd.DataFrame:
    """What each stage found when two panoramas, or two photographs, were compared: a row a stage.

    Given as to ``common_landmarks``; the last row is the answer, and why there is no more.
    """
    from vrchain.landmarks.matching.why import why_files, why_panoramas

    left, right = _opened(a), _opened(b)
    if isinstance(left, Panorama) and isinstance(right, Panorama):
        check_comparable(left, right)
        told = why_panoramas(examine(left), examine(right))
    elif isinstance(left, Panorama) or isinstance(right, Panorama):
        raise ImageError(_ONE_OF_EACH)
    else:
        told = why_files(left, right)
    return pd.DataFrame(list(told), columns=["stage", "found"]).set_index("stage")


def load_database(
    folder: str | Path, source: Source | None = None, floor: str | None = None
) -> list[tuple[Pose, Panorama]]:
    """The panoramas of an image database, each with the pose that it was taken from, in its order.

    source: how to read the pictures, instead of what the database tells. floor: of a house whose
    floors have a frame each. ImageError, which names file and row: what cannot be read.
    """
    entries = on_floor(read_database(Path(folder)), floor)
    return [(entry.pose, panorama) for entry, panorama in opened(entries, source)]


def _opened(picture: Panorama | str | Path) -> Panorama | Path:
    if isinstance(picture, Panorama):
        return picture
    return Panorama.load(picture) if Path(picture).is_dir() else Path(picture)


def home_vector(
    here: Panorama,
    home: Panorama,
    method: str = "epipolar",
    heading_rad: float | None = None,
) -> HomeVector | None:
    """Which way home lies, by the panorama from here and the one from home: ``homing.step``.

    None when the two share too little.
    """
    return step(method, snapshot(here), snapshot(home), heading_rad)


@dataclass(frozen=True, eq=False)
class Watched:
    """A ledger over several machines as it stood: blocks that came, members, what is wrong.

    blocks: height, author, records. members: member, height, behind (blocks), waiting (in its
    outbox), refused, alarms (a server's log was wrong), one row each that has said so.
    """

    blocks: pd.DataFrame
    members: pd.DataFrame
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        tables = (table.to_string(index=False) for table in (self.blocks, self.members))
        return "\n\n".join([*tables, *self.notes])

    def _repr_html_(self) -> str:
        tables = (table.to_html(index=False) for table in (self.blocks, self.members))
        return "".join([*tables, *(f"<p>{escape(note)}</p>" for note in self.notes)])


def watch(
    ledger: str | Path, folder: str | Path | None = None, seconds: float = 30.0, newest: int = 10
) -> Watched:
    """Watch a ledger for so long; in a notebook what comes is shown as it comes, and stays.

    ledger: a folder, or ``nats://HOST,...``, of which ``folder`` is this machine's copy. newest:
    how many blocks are shown. LedgerError kinds.
    """
    from vrchain.ledger.network.opening import open_ledger
    from vrchain.ledger.network.watching import watched

    lines: list[tuple[int, str, str]] = []
    seen, show = _watched(lines, [], 0), _shown()
    with open_ledger(ledger, folder, writable=False) as opened:
        lines += [_line(entry) for entry in opened.entries(max(0, opened.head.height - newest + 1))]
        for entries, news in watched(opened, seconds):
            lines = [*lines, *map(_line, entries)][-newest:]
            told = [result for result, _ in news]
            now = _watched(lines, told, opened.head.height)
            if repr(now) != repr(seen):
                show(now)
            seen = now
    return seen


def _line(entry: "Entry") -> tuple[int, str, str]:
    return entry.block.height, entry.block.author, ", ".join(map(str, entry.records))


def _watched(
    lines: Sequence[tuple[int, str, str]], told: Sequence[dict[str, Any]], height: int
) -> Watched:
    members = [row for row in told if "member" in row]
    height = max([height, *(row["height"] for row in members)])
    columns = ["member", "height", "waiting", "refused", "alarms"]
    table = pd.DataFrame(members, columns=columns).sort_values("member")
    table.insert(2, "behind", height - table.height)
    notes = [", ".join(f"{k}: {v}" for k, v in row.items()) for row in told if "member" not in row]
    return Watched(pd.DataFrame(lines, columns=["height", "author", "records"]), table, (*notes,))


def _shown() -> Callable[[Watched], None]:
    """Shows each in the place of the one before, where a notebook runs; else nothing."""
    try:
        from IPython import get_ipython
        from IPython.display import display
    except ImportError:
        return lambda view: None
    if get_ipython() is None:
        return lambda view: None
    return display("...", display_id=True).update


def reproduced(profile: str | None = None) -> Results:
    """The results of a profile; those that are not there are made first, which takes minutes.

    profile: quick or paper; the one that VRCHAIN_PROFILE names, or quick, if none is given.
    """
    results = Results.here(profile)
    missing = [stage for stage in STAGES if not results.has(stage)]
    if missing:
        reproduce(results, missing)
    return results


def figure(name: str, results: Results | None = None) -> "Figure":
    """One of the project's figures, by the name of its script in ``figures/``.

    results: that it is drawn from; ``Results.here()`` if none are given. FigureError: there is no
    such figure. ReproductionError: the stage that it needs has not been run.
    """
    from vrchain.plots.scripts import draw_of

    return draw_of(name)(results or Results.here())[0]
