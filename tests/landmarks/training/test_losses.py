"""What the network is asked for is what the proposer takes from it."""

from dataclasses import replace
from typing import Any

import answers
import numpy as np
import pytest

from vrchain.geometry import Pose
from vrchain.landmarks.training.examples import Examples
from vrchain.seeding import generator

torch = pytest.importorskip("torch", reason="learned features need torch (extra `learned`)")
from vrchain.landmarks.training.losses import (  # noqa: E402
    box_overlap,
    contrastive,
    landmark_embeddings,
    losses,
    target_of,
)

CENTRES_M = np.array([[10.0, 0.0], [0.0, 14.0], [-9.0, 1.0], [4.0, -20.0], [-15.0, -15.0]])
POSES = (Pose(0.5, -0.3, 3.0), Pose(2.0, 1.0, -1.0))
LOOKS = answers.looks(len(CENTRES_M))
NOBODY = torch.zeros(0, answers.EMBEDDED)


def examples() -> Examples:
    cells = np.stack([answers.posts(p, CENTRES_M) for p in POSES]).astype(np.int16)
    kinds = ["house", "tree", "pole", "sign", "bin"]
    return Examples(
        (), cells, np.zeros(cells.shape, dtype=np.float16), np.zeros(2, dtype=np.int16),
        np.array([(p.x_m, p.y_m, p.yaw_rad) for p in POSES]), CENTRES_M, np.array(kinds),
        np.array(kinds),
    )  # fmt: skip


def said(mirrored: bool = False, looks: np.ndarray = LOOKS) -> dict:
    known = [answers.perfect(answers.posts(p, CENTRES_M), p, CENTRES_M, looks) for p in POSES]
    stacked = {name: torch.from_numpy(np.stack([k[name] for k in known])) for name in known[0]}
    if mirrored:
        stacked = {name: a.flip(-1) for name, a in stacked.items()}
        stacked["box"] = stacked["box"][:, [2, 1, 0, 3]]
        stacked["middle"] = stacked["middle"] * torch.tensor([-1, 1, 1, 1])[:, None, None]
    return stacked


def losses_of(found: dict, targets: list, strangers: Any = NOBODY) -> dict:
    return losses(found, targets, landmark_embeddings(found, targets), strangers)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_network_that_is_never_wrong_has_nothing_to_learn(mirrored: bool) -> None:
    targets = [target_of(examples(), i, mirrored) for i in range(2)]
    found = losses_of(said(mirrored), targets)
    assert found["landmark"] < 1e-3 and found["box"] < 1e-5 and found["embedding"] < 0.05
    for target, answer in zip(targets, said(mirrored)["middle"], strict=True):
        own = answer.flatten(1)[:2, target.cell].T
        assert torch.allclose(own, target.middle, atol=1e-4)


@pytest.mark.parametrize("part", ["landmark", "box", "middle", "kind", "embedding"])
def test_every_mistake_costs(part: str) -> None:
    targets = [target_of(examples(), i) for i in range(2)]
    right = losses_of(said(), targets)
    wrong = said()
    wrong[part] = wrong[part].roll(40, dims=-1) if part != "kind" else -wrong[part]
    found = losses_of(wrong, targets)
    assert found[part] > right[part] + 0.1 and found["total"] > right["total"]


def test_to_be_like_a_stranger_costs() -> None:
    targets = [target_of(examples(), i) for i in range(2)]
    alone = losses_of(said(), targets)["embedding"]
    strangers = torch.from_numpy(LOOKS[:3].astype(np.float32))
    assert losses_of(said(), targets, strangers)["embedding"] > alone + 0.1


def test_landmarks_of_one_panorama_alone_teach_nothing_of_looks() -> None:
    one = torch.from_numpy(LOOKS.astype(np.float32)).requires_grad_()
    loss = contrastive(one, torch.arange(5), torch.zeros(5), NOBODY)
    loss.backward()
    assert loss == 0 and (one.grad == 0).all()


def test_a_part_of_a_landmark_looks_like_all_of_one_that_is_alike_all_over() -> None:
    targets = [target_of(examples(), i) for i in range(2)]
    for uneven in (0.0, 1.0):
        found = said()
        found["embedding"] = found["embedding"] + torch.linspace(0, uneven, answers.SHAPE[1])
        whole, parts = (
            landmark_embeddings(found, targets, draws=draws)[0]
            for draws in (None, generator(0, "parts"))
        )
        assert torch.isfinite(parts).all()
        assert torch.allclose(whole, parts, atol=1e-3 if uneven else 1e-5) == (not uneven)


def test_boxes_around_a_cell_overlap_as_areas_do() -> None:
    a = torch.tensor([[1.0, 1.0, 1.0, 1.0]] * 3)
    b = torch.tensor([[1.0, 1.0, 1.0, 1.0], [2.0, 1.0, 2.0, 1.0], [0.5, 0.5, 0.5, 0.5]])
    assert torch.allclose(box_overlap(a, b), torch.tensor([1.0, 0.5, 0.25]))


def test_a_view_without_landmarks_is_an_example_too() -> None:
    bare = examples()
    bare = replace(bare, cells=np.full_like(bare.cells, -1))
    target = target_of(bare, 0)
    assert len(target.ids) == len(target.cell) == 0
    found = losses_of(said(), [target, target_of(bare, 1)])
    assert torch.isfinite(found["total"]) and found["landmark"] > 0.1
