"""Proposals: what in a panorama may be a landmark, where it stands and what it looks like.

The network answers for every cell. Cells whose answers agree on one box are one proposal; it is
placed where they say, on the average, that the middle of their landmark is.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.extraction.raster import CELL_PX, cell_slopes, picture_of, unseen_cells
from vrchain.panorama import CameraRig, Panorama

Array = NDArray[np.float64]
Answers = dict[str, NDArray[np.float32]]
"""Of a network, for every cell: (channels, rows, columns) each."""
Overlaps = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.floating]]

KINDS = (
    "house", "shop", "barn", "tree", "bush", "hedge", "fence", "wall", "vehicle", "mailbox",
    "lamp", "pole", "sign", "bin", "hydrant",
)  # fmt: skip
EMBEDDED = 64  # numbers that say what a landmark looks like
LOCAL = 32  # numbers that say what a cell looks like, to find the same spot from elsewhere
BEARING_UNIT_RAD, RANGE_UNIT_M = 0.1, 10.0  # the network's units of a landmark's middle
_LEAST_SCORE = 0.2
_LEAST_LANDMARK = 0.5  # probability from which a cell belongs to a landmark
_SAME_BOX = 0.5  # intersection over union from which two boxes are one proposal
_DRAFT_BOX = 0.2  # a cell whose own box overlaps less with each draft has no say in them
_OWN_BOX = 0.45  # a cell whose own box overlaps less with each proposal belongs to none
_AROUND_CELLS, _LEAST_CONTRAST = 13, 1.0  # grey levels
_NOISE = 0.5  # share of the contrast that noise keeps when it is blurred, at most
_LEAST_CELLS = 3
_MOST = 160
_LEAST_UNSURE_RAD = 0.004
_SIGNS = np.array([-1, -1, 1, 1], dtype=np.float32)  # of a box's edges, from a cell within


@dataclass(frozen=True, eq=False)
class Proposals:
    """Proposals of one panorama, surest first; angles in the robot's frame.

    score: (n,) 0..1; box: (n, 4) bearing of its right and left edge, slope of its lower and upper
    edge; the left edge may lie beyond pi; bearing_rad, range_m: (n,) the middle of the thing
    itself on the map; bearing_std_rad, range_std: (n,) how unsure they are, the latter as a share
    of the range; kind: (n,) index into ``KINDS``; embedding: (n, d) float32, unit vectors;
    cell, owner: (m,) cells of the picture, flat, and the proposal that each belongs to.
    """

    score: Array
    box: Array
    bearing_rad: Array
    range_m: Array
    bearing_std_rad: Array
    range_std: Array
    kind: NDArray[np.int64]
    embedding: NDArray[np.float32]
    cell: NDArray[np.int64]
    owner: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.score)

    def take(self, index: ArrayLike) -> "Proposals":
        """The proposals at ``index`` (integers), in that order."""
        i = np.asarray(index, dtype=int)
        place = np.full(len(self), -1)
        place[i] = np.arange(len(i))
        kept = place[self.owner] >= 0
        own = {f.name: getattr(self, f.name)[i] for f in fields(self)[:-2]}
        return Proposals(**own, cell=self.cell[kept], owner=place[self.owner[kept]])

    @property
    def xy_m(self) -> Array:
        """Where the middles are, robot's frame: (n, 2)."""
        return self.range_m[:, None] * np.stack(
            [np.cos(self.bearing_rad), np.sin(self.bearing_rad)], axis=1
        )


def propose(
    panorama: Panorama, network: Callable[[NDArray[np.uint8]], Answers]
) -> tuple[Proposals, NDArray[np.float32]]:
    """What may be landmarks in a panorama, and what each cell looks like: (d, rows, columns)."""
    shown = picture_of(panorama)
    answers = network(shown)
    answers["landmark"][0][_blank(shown)] = -np.inf
    if (unseen := unseen_cells(panorama)) is not None:
        answers["landmark"][0][unseen] = -np.inf
    return from_answers(answers, panorama.rig), answers["local"]


def _blank(picture: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Cells around which there is nothing but one colour, or noise: (rows, columns).

    So it is where a camera failed. Of what noise there is, little is left when it is blurred.
    """
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.float32)
    fine, coarse = _deviation(grey), _deviation(cv2.blur(grey, (3, 3)))
    return np.asarray((fine < _LEAST_CONTRAST) | (coarse < _NOISE * fine))


def _deviation(grey: ArrayLike) -> NDArray[np.float32]:
    """The standard deviation around each cell."""
    x = np.asarray(grey, dtype=np.float32)
    cells = x.shape[1] // CELL_PX, x.shape[0] // CELL_PX
    mean, square = (
        cv2.blur(cv2.resize(v, cells, interpolation=cv2.INTER_AREA), (_AROUND_CELLS,) * 2)
        for v in (x, x * x)
    )
    return np.asarray(np.sqrt(np.maximum(square - mean * mean, 0)))


def from_answers(answers: Answers, rig: CameraRig) -> Proposals:
    """Proposals from the network's answers, (channels, rows, columns) each."""
    landmark, fit = _logistic(answers["landmark"][0]), _logistic(answers["fit"][0])
    quality = landmark * fit
    columns = landmark.shape[1]
    row, column = np.nonzero(landmark > _LEAST_LANDMARK)
    edge = _short(np.exp(answers["box"][:, row, column].clip(-3, 7).astype(float)), 6)
    boxes = (edge * _SIGNS[:, None] + np.stack([column, row, column, row])).T.astype(np.float32)
    sure = quality[row, column]
    period = columns if rig.closed else None
    surest_first = np.argsort(-sure, kind="stable")[: int((sure > _LEAST_SCORE).sum())]
    drafts = boxes[_one_of_each(boxes, surest_first, period)]
    chosen = _agreed_boxes(boxes, sure, drafts, period)
    if len(chosen) == 0:
        return nothing()
    appearance = np.zeros((len(chosen), len(answers["embedding"])))
    parts = list(_in_parts(boxes, chosen, period))
    alike, owner = _most_like(parts, len(boxes))
    for part, near, overlap in parts:
        # a landmark's other pieces say what it looks like too, so all that overlap are heard
        weight = overlap.astype(float) ** 2 * landmark[row[part], column[part]][:, None]
        appearance[near] += weight.T @ answers["embedding"][:, row[part], column[part]].T
    length = np.maximum(np.linalg.norm(appearance, axis=1, keepdims=True), 1e-9)
    own = alike >= _OWN_BOX
    sure = sure[own]
    row, column, owner = row[own], column[own], owner[own]
    n = len(chosen)
    weight = landmark[row, column].astype(float)
    total = np.maximum(np.bincount(owner, weight, n), 1e-9)
    kinds = [np.bincount(owner, weight * c, n) / total for c in answers["kind"][:, row, column]]
    offset, log_range, *unsure = answers["middle"][:, row, column].astype(float)
    # angles are averaged as turns from the box's middle, which may lie across the seam
    half_turn_cells = columns * np.pi / rig.span_rad
    left, top, right, bottom = chosen.T.astype(float)
    across = column - ((left + right) / 2)[owner]
    across = (across + half_turn_cells) % (2 * half_turn_cells) - half_turn_cells
    step_rad = rig.span_rad / columns
    bearing, bearing_std = _agreed(
        offset * BEARING_UNIT_RAD - across * step_rad, unsure[0], owner, n
    )
    log_range, range_std = _agreed(log_range, unsure[1], owner, n)
    middle = rig.span_rad / 2 - ((left + right) / 2 + 0.5) * step_rad
    score = np.zeros(n)
    np.maximum.at(score, owner, sure)
    slopes = cell_slopes()
    edges = [
        rig.span_rad / 2 - (right + 0.5) * step_rad,
        rig.span_rad / 2 - (left + 0.5) * step_rad,
        np.interp(bottom, np.arange(len(slopes)), slopes),
        np.interp(top, np.arange(len(slopes)), slopes),
    ]
    found = Proposals(
        score,
        np.stack(edges, axis=1),
        wrap_angle_rad(middle + bearing),
        RANGE_UNIT_M * np.exp(log_range),
        np.maximum(bearing_std * BEARING_UNIT_RAD, _LEAST_UNSURE_RAD),
        range_std,
        np.argmax(kinds, axis=0),
        (appearance / length).astype(np.float32),
        row * columns + column,
        owner,
    )
    large = np.flatnonzero(np.bincount(owner, minlength=n) >= _LEAST_CELLS)
    return found.take(large[np.argsort(-score[large], kind="stable")][:_MOST])


def nothing() -> Proposals:
    """No proposals."""
    none, whole = np.empty(0), np.empty(0, dtype=np.int64)
    return Proposals(
        none, np.empty((0, 4)), none, none, none, none, whole,
        np.empty((0, EMBEDDED), dtype=np.float32), whole, whole,
    )  # fmt: skip


def overlaps(
    a: NDArray[np.floating], b: NDArray[np.floating], period: float | None = None
) -> NDArray[np.floating]:
    """Intersection over union of boxes (n, 4) and (m, 4): left, top, right, bottom. (n, m).

    ``period``: the columns of a full turn, where there is one.
    """
    return _overlaps(_shape(a)[:, :, None], _shape(b)[:, None], period)


def _shape(boxes: NDArray[np.floating]) -> NDArray[np.floating]:
    """Of boxes (n, 4): middle, half the width, top, bottom, area. (5, n)."""
    left, top, right, bottom = boxes.T
    width = right - left
    return np.stack([(left + right) / 2, width / 2, top, bottom, width * (bottom - top)])


def _overlaps(
    a: NDArray[np.floating], b: NDArray[np.floating], period: float | None
) -> NDArray[np.floating]:
    """The same of shapes (5, ...), each of A with each of B."""
    (middle_a, half_a, top_a, bottom_a, area_a), (middle_b, half_b, top_b, bottom_b, area_b) = a, b
    apart = middle_b - middle_a
    if period is not None:
        apart = (apart + period / 2) % period - period / 2
    width = np.minimum(half_a, apart + half_b) - np.maximum(-half_a, apart - half_b)
    height = np.minimum(bottom_a, bottom_b) - np.maximum(top_a, top_b)
    common = width.clip(0) * height.clip(0)
    found: NDArray[np.floating] = common / (area_a + area_b - common)
    return found


def _one_of_each(
    boxes: NDArray[np.float32], candidates: NDArray[np.int64], period: int | None
) -> NDArray[np.int64]:
    """Those candidates, surest first, that are not the same box as a surer one."""
    chosen = []
    shape = _shape(boxes[candidates])
    while len(candidates):
        chosen.append(candidates[0])
        other = _overlaps(shape[:, :1], shape, period) <= _SAME_BOX
        other[0] = False
        candidates, shape = candidates[other], shape[:, other]
    return np.array(chosen, dtype=np.int64)


def _agreed_boxes(
    boxes: NDArray[np.float32],
    sure: NDArray[np.float32],
    drafts: NDArray[np.float32],
    period: int | None,
) -> NDArray[np.float32]:
    """What the cells of each draft agree on, on the average; drafts that agree are one."""
    n = len(drafts)
    if n == 0:
        return drafts
    alike, owner = _most_like(_in_parts(boxes, drafts, period), len(boxes))
    own = alike >= _DRAFT_BOX
    owner, weight, own_boxes = owner[own], sure[own], boxes[own]
    total = np.maximum(np.bincount(owner, weight, n), 1e-9)
    middle = (own_boxes[:, 0] + own_boxes[:, 2]) / 2
    apart = middle - ((drafts[:, 0] + drafts[:, 2]) / 2)[owner]
    round_about = np.round(apart / period) * period if period is not None else np.zeros_like(apart)
    shift = np.stack([round_about, np.zeros_like(apart)] * 2, axis=1)
    found = np.stack(
        [np.bincount(owner, weight * edge, n) / total for edge in (own_boxes - shift).T], axis=1
    ).astype(np.float32)
    most_first = np.argsort(-total, kind="stable")
    return found[_one_of_each(found, most_first[total[most_first] > 1e-9], period)]


def _most_like(parts: Iterable[Overlaps], n: int) -> tuple[Array, NDArray[np.int64]]:
    """How much each of n boxes overlaps with the chosen one most like it, and which: (n,) each."""
    alike, which = np.zeros(n), np.zeros(n, dtype=np.int64)
    for part, near, overlap in parts:
        alike[part], which[part] = overlap.max(axis=1), near[overlap.argmax(axis=1)]
    return alike, which


def _in_parts(
    boxes: NDArray[np.float32], chosen: NDArray[np.float32], period: int | None
) -> Iterator[Overlaps]:
    """Overlaps of a few hundred neighbouring boxes at a time with the chosen ones near them.

    Yields which boxes, which chosen ones, one or more, and (boxes, chosen) overlaps.
    """
    order = np.argsort(boxes[:, 0] + boxes[:, 2], kind="stable")
    middle, half = (chosen[:, 0] + chosen[:, 2]) / 2, (chosen[:, 2] - chosen[:, 0]) / 2
    for start in range(0, len(boxes), 256):
        part = order[start : start + 256]
        low, high = boxes[part, 0].min(), boxes[part, 2].max()
        apart = middle - (low + high) / 2
        if period is not None:
            apart = (apart + period / 2) % period - period / 2
        near = np.flatnonzero(np.abs(apart) < half + (high - low) / 2)
        if len(near):
            yield part, near, overlaps(boxes[part], chosen[near], period)


def _agreed(
    values: Array, log_unsure: Array, owner: NDArray[np.int64], n: int
) -> tuple[Array, Array]:
    """What the cells of each of n proposals agree on, the surer counting more; how unsure it is.

    Neighbouring cells err alike: many of them are no surer than one.
    """
    weight = np.exp(-log_unsure.clip(-5, 3))
    total = np.maximum(np.bincount(owner, weight, n), 1e-9)
    mean = np.bincount(owner, weight * values, n) / total
    count = np.bincount(owner, minlength=n)
    return mean, np.sqrt(2) * count / total  # a Laplace distribution's deviation


def _logistic(x: NDArray[np.float32]) -> NDArray[np.float32]:
    return _short(1 / (1 + np.exp(-x.astype(float))), 20)


def _short(x: Array, bits: int) -> NDArray[np.float32]:
    """So many binary digits behind the point: processors' exponentials differ in the last ones."""
    return np.asarray(np.round(x * 2.0**bits) / 2.0**bits, dtype=np.float32)
