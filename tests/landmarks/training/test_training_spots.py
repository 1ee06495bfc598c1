"""Spots seen from two places are the same points of the world."""

from dataclasses import replace

import numpy as np
import pytest

from vrchain.landmarks.training.examples import (
    ExampleConfig,
    Examples,
    make_examples,
    read_examples,
)
from vrchain.seeding import generator

torch = pytest.importorskip("torch", reason="learned features need torch (extra `learned`)")
from vrchain.landmarks.training.spots import (  # noqa: E402
    SpotPairs,
    cells_of,
    points_m,
    spot_loss,
    spots_of,
    spots_right,
)

MEMBERS = np.arange(3)


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Examples:
    config = ExampleConfig(seed=5, suburbs=1, groups=1, panoramas=3, reach_m=(1.0, 8.0))
    (file,) = make_examples(config, tmp_path_factory.mktemp("examples"))
    return read_examples(file)


@pytest.fixture(scope="module")
def spots(seen: Examples) -> list[SpotPairs]:
    return spots_of(seen, MEMBERS, generator(0, "spots"), mirrored=False)


def places(seen: Examples) -> "torch.Tensor":
    """What a network would answer that knows where in the world each cell looks: (n, d, ...)."""
    rows, columns = seen.cells.shape[1:]
    waves = generator(0, "waves").normal(size=(3, 32)) * 2.0  # points apart look unlike
    known = []
    for i in MEMBERS:
        phase = points_m(seen, int(i), np.arange(rows * columns)) @ waves
        known.append(np.concatenate([np.cos(phase), np.sin(phase)], axis=1).T)
    return torch.from_numpy(np.stack(known).reshape(len(MEMBERS), -1, rows, columns)).float()


def test_a_cell_looks_where_it_is_found_again(seen: Examples) -> None:
    shown = np.flatnonzero(seen.range_m[0].ravel() > 0.5)
    cell, range_m = cells_of(seen, 0, points_m(seen, 0, shown))
    assert (cell == shown).all()
    np.testing.assert_allclose(range_m, seen.range_m[0].ravel()[shown].astype(float), rtol=1e-9)


def test_spots_are_the_same_points_of_the_same_landmarks(
    seen: Examples, spots: list[SpotPairs]
) -> None:
    assert len(spots) == 4
    for pair in spots:
        a, b = pair.at_first.numpy(), pair.at_second.numpy()[: len(pair.at_first)]
        assert len(a) > 100
        apart = np.linalg.norm(
            points_m(seen, pair.first, a) - points_m(seen, pair.second, b), axis=1
        )
        range_m = seen.range_m[pair.second].ravel()[b].astype(float)
        assert (apart < np.maximum(0.21, 0.03 * range_m)).all() and np.median(apart) < 0.2
        own = seen.cells[pair.first].ravel()[a]
        assert (own >= 0).all() and (own == seen.cells[pair.second].ravel()[b]).all()


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_network_that_knows_places_has_little_to_learn(seen: Examples, mirrored: bool) -> None:
    found = spots_of(seen, MEMBERS, generator(0, "spots"), mirrored)
    known = places(seen)
    known = known.flip(-1) if mirrored else known
    right, n = spots_right(known, found)
    assert right > 0.97 * n > 300
    assert spot_loss(known, found) < 0.4
    elsewhere = known.roll(40, dims=-1)  # both turned alike: still the same to each other
    assert spots_right(elsewhere, found)[0] < 0.2 * n


def test_what_lies_near_a_spot_does_not_count_against_it(spots: list[SpotPairs]) -> None:
    for pair in spots:
        assert pair.near.any() and not pair.near.diagonal().any()
        assert pair.near.float().mean() < 0.2


def test_panoramas_without_landmarks_teach_nothing(seen: Examples) -> None:
    bare = replace(seen, cells=np.full_like(seen.cells, -1))
    found = spots_of(bare, MEMBERS, generator(0, "spots"), mirrored=False)
    known = places(seen).requires_grad_()
    loss = spot_loss(known, found)
    loss.backward()
    assert found == [] and loss == 0 and (known.grad == 0).all()
    assert spots_right(known, found) == (0, 0)
