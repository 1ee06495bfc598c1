"""What the network should answer for one panorama, and how far it is from it.

Boxes: the logarithm of intersection over union (Yu et al., "UnitBox", 2016). Middles: the negative
log-likelihood of a Laplace distribution whose width is learned. What landmarks look like: the
supervised contrastive loss (Khosla et al., 2020) over the landmarks of several panoramas.
"""

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor, nn

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.extraction.proposer import BEARING_UNIT_RAD, KINDS, RANGE_UNIT_M
from vrchain.landmarks.training.examples import Examples

_LEAST_RANGE_M = 0.5
_TEMPERATURE = 0.07
_PART, _PART_EXTENT = 0.4, (0.3, 1.0)  # how often a part of a landmark is drawn, and how much of it
_WEIGHTS = {
    "landmark": 3.0, "fit": 0.3, "box": 1.0, "middle": 0.5, "kind": 0.3, "embedding": 1.0,
}  # fmt: skip

Embedded = tuple[Tensor, Tensor, Tensor]


@dataclass(frozen=True, eq=False)
class Target:
    """What to answer for one panorama's cells, of which (m,) show landmarks.

    cell: (m,) flat index; owner: (m,) place of its landmark in ``ids``; ids: (k,) object ids;
    box: (m, 4) cells to the left, top, right and bottom edge of what is seen of the landmark;
    middle: (m, 2) bearing to its middle and log of range, in the network's units; kind: (m,);
    weight: (m,) so that small landmarks count.
    """

    cell: Tensor
    owner: Tensor
    ids: NDArray[np.int64]
    box: Tensor
    middle: Tensor
    kind: Tensor
    weight: Tensor


def target_of(examples: Examples, index: int, mirrored: bool = False) -> Target:
    """The target of panorama ``index``, or of its mirror image."""
    cells = examples.cells[index]
    row, column = np.nonzero(cells >= 0)
    ids, owner = np.unique(cells[row, column], return_inverse=True)
    n_columns = cells.shape[1]
    turn = 2 * np.pi / n_columns
    area = np.bincount(owner, minlength=len(ids))
    angle = column * turn
    towards = np.bincount(owner, np.sin(angle)), np.bincount(owner, np.cos(angle))
    middle_of = np.arctan2(*towards)[owner]
    around = wrap_angle_rad(angle - middle_of) / turn
    left, right, top, bottom = (np.full(len(ids), edge) for edge in (np.inf, -np.inf) * 2)
    np.minimum.at(left, owner, around)
    np.maximum.at(right, owner, around)
    np.minimum.at(top, owner, row)
    np.maximum.at(bottom, owner, row)
    box = np.stack(
        [around - left[owner], row - top[owner], right[owner] - around, bottom[owner] - row], axis=1
    )
    x_m, y_m, yaw_rad = examples.poses[index]
    away_m = examples.centres_m[ids] - (x_m, y_m)
    middle_rad = np.arctan2(away_m[:, 1], away_m[:, 0]) - yaw_rad
    bearing_rad = np.pi - (column + 0.5) * turn
    offset_rad = wrap_angle_rad(middle_rad[owner] - bearing_rad)
    range_m = np.maximum(np.hypot(*away_m.T), _LEAST_RANGE_M)
    if mirrored:
        column, box, offset_rad = n_columns - 1 - column, box[:, [2, 1, 0, 3]], -offset_rad
    middle = np.stack(
        [offset_rad / BEARING_UNIT_RAD, np.log(range_m / RANGE_UNIT_M)[owner]], axis=1
    )
    number = {kind: i for i, kind in enumerate(KINDS)}
    kind = np.array([number[k] for k in examples.kinds[ids]], dtype=np.int64)
    return Target(
        torch.from_numpy(row * n_columns + column),
        torch.from_numpy(owner),
        ids,
        torch.from_numpy(np.asarray(box + 0.5, dtype=np.float32)),
        torch.from_numpy(np.asarray(middle, dtype=np.float32)),
        torch.from_numpy(kind[owner]),
        torch.from_numpy((1 / np.sqrt(area))[owner].astype(np.float32)),
    )


def losses(
    answers: dict[str, Tensor], targets: list[Target], embedded: Embedded, strangers: Tensor
) -> dict[str, Tensor]:
    """The parts of the loss of panoramas of one group, and ``total``.

    embedded: what ``landmark_embeddings`` finds. strangers: (n, embedded) unit embeddings of
    landmarks elsewhere, alike to none of these.
    """
    parts: dict[str, list[Tensor]] = {name: [] for name in _WEIGHTS if name != "embedding"}
    for i, target in enumerate(targets):
        own = {name: a[i].flatten(1) for name, a in answers.items()}
        wanted = torch.zeros(own["landmark"].shape[1])
        importance = torch.ones_like(wanted)
        wanted[target.cell] = 1.0
        importance[target.cell] = (5 * target.weight).clamp(0.5, 2.0)
        parts["landmark"].append(
            F.binary_cross_entropy_with_logits(own["landmark"][0], wanted, importance)
        )
        seen = {name: a[:, target.cell].T for name, a in own.items()}
        share = target.weight / target.weight.sum()
        overlap = box_overlap(seen["box"].clamp(-3, 7).exp(), target.box)
        parts["box"].append(-(overlap.clamp_min(1e-4).log() * share).sum())
        fit = F.binary_cross_entropy_with_logits(
            seen["fit"][:, 0], overlap.detach(), reduction="none"
        )
        parts["fit"].append((fit * share).sum())
        unsure = seen["middle"][:, 2:].clamp(-5, 3)
        astray = (seen["middle"][:, :2] - target.middle).abs()
        parts["middle"].append(((astray * (-unsure).exp() + unsure).sum(dim=1) * share).sum())
        kind = F.cross_entropy(seen["kind"], target.kind, reduction="none")
        parts["kind"].append((kind * share).sum())
    found = {name: torch.stack(values).mean() for name, values in parts.items()}
    found["embedding"] = contrastive(*embedded, strangers)
    found["total"] = torch.stack([w * found[name] for name, w in _WEIGHTS.items()]).sum()
    return found


def box_overlap(a: Tensor, b: Tensor) -> Tensor:
    """Intersection over union of boxes around one cell: (m, 4) distances to their four edges."""
    common = torch.minimum(a, b)
    inside = (common[:, 0] + common[:, 2]) * (common[:, 1] + common[:, 3])
    area_a, area_b = ((d[:, 0] + d[:, 2]) * (d[:, 1] + d[:, 3]) for d in (a, b))
    return inside / (area_a + area_b - inside)


def landmark_embeddings(
    answers: dict[str, Tensor],
    targets: list[Target],
    centre: nn.Module | None = None,
    draws: np.random.Generator | None = None,
) -> Embedded:
    """Of each landmark of each panorama: unit embedding (n, embedded), object id, panorama.

    centre: takes away what all landmarks have in common, where the network did not. With ``draws``
    of some landmarks a part alone, as proposals often hold no more.
    """
    found, ids, panorama = [], [], []
    for i, target in enumerate(targets):
        seen = answers["embedding"][i].flatten(1)[:, target.cell].T
        weight = torch.ones(len(target.cell)) if draws is None else _parts(target, draws)
        own = torch.zeros(len(target.ids), seen.shape[1])
        total = torch.zeros(len(target.ids)).index_add(0, target.owner, weight)
        own = own.index_add(0, target.owner, seen * weight[:, None])
        found.append(own / total[:, None])
        ids.append(torch.from_numpy(target.ids.astype(np.int64)))
        panorama.append(torch.full((len(target.ids),), i))
    together = torch.cat(found)
    if centre is not None:
        together = centre(together)
    return F.normalize(together, dim=1), torch.cat(ids), torch.cat(panorama)


def _parts(target: Target, draws: np.random.Generator) -> Tensor:
    """How much each cell counts, (m,): nearly nothing outside a part drawn of its landmark."""
    n = len(target.ids)
    weight = torch.ones(len(target.cell))
    for low, high in ((0, 2), (1, 3)):  # across, and up and down
        extent = np.where(draws.random(n) < _PART, draws.uniform(*_PART_EXTENT, n), 1.0)
        start = draws.uniform(0, 1, n) * (1 - extent)
        begins, ends = (torch.from_numpy(x).float()[target.owner] for x in (start, start + extent))
        place = target.box[:, low] / (target.box[:, low] + target.box[:, high])
        weight *= torch.where((place >= begins) & (place <= ends), 1.0, 1e-3)
    return weight


def contrastive(embedding: Tensor, ids: Tensor, panorama: Tensor, strangers: Tensor) -> Tensor:
    """Each landmark should be most alike to itself in the other panoramas."""
    alike = embedding @ embedding.T / _TEMPERATURE
    same = ids[:, None] == ids[None, :]
    pair_i, pair_j = torch.nonzero(same & (panorama[:, None] != panorama[None, :]), as_tuple=True)
    if len(pair_i) == 0:
        return embedding.sum() * 0.0
    others = alike.masked_fill(same, -torch.inf)
    if len(strangers):
        others = torch.cat([others, embedding @ strangers.T / _TEMPERATURE], dim=1)
    rivals = torch.logsumexp(others, dim=1)[pair_i]
    right = alike[pair_i, pair_j]
    return (torch.logaddexp(right, rivals) - right).mean()
