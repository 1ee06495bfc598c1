from functools import partial

import numpy as np
import pytest

from vrchain.seeding import generator
from vrchain.world import textures
from vrchain.world.model import OPAQUE, Surface
from vrchain.world.things import foliage, plants
from vrchain.world.things.plants import TreePlan

GREEN = textures.hsv(90, 0.5, 0.6)
SPECIES = sorted(set(plants.SPECIES))


CARDS = {
    "twig": partial(foliage.twig, size_px=80, colour=GREEN, leaf_px=10.0, slim=0.6),
    "strands": partial(foliage.strands, shape=(160, 48), colour=GREEN),
    "bough": partial(foliage.bough, shape=(112, 80), colour=GREEN),
}


def tree(species: str, seed: int = 0) -> tuple[TreePlan, tuple[Surface, ...]]:
    plan = TreePlan(species, height_m=7.0, canopy_radius_m=2.1, foot_radius_m=0.65)
    return plan, plants.build_tree(plan, generator(seed, "tree", species))


@pytest.mark.parametrize("name", CARDS)
def test_a_leaf_card_is_partly_air_of_the_leaves_colour_with_a_ragged_rim(name: str) -> None:
    picture, again = (CARDS[name](generator(0, "foliage", name)) for _ in range(2))
    solid = picture[..., 3] >= OPAQUE
    assert set(np.unique(picture[..., 3])) == {0, 255}
    assert 0.3 < solid.mean() < 0.75
    air = picture[~solid][:, :3]
    assert (air == air[0]).all()
    assert np.abs(air[0] - 0.8 * np.array(GREEN)).max() <= 1
    assert np.array_equal(picture, again)

    # Along the rim is hardly a leaf, but for where a twig's foot or a strand's top is.
    sides = [solid[:, 0], solid[:, -1], solid[0] if name != "strands" else solid[-1]]
    assert max(side.mean() for side in sides) < 0.2


def test_cards_stand_on_their_foot_and_face_right_times_up() -> None:
    foot = np.array([(1.0, 2.0, 3.0), (0.0, 0.0, 0.0)])
    right, up = np.array([(2.0, 0, 0)] * 2), np.array([(0, 0, 1.0)] * 2)
    flat = foliage.Cards(foot, right, up).part()
    assert flat.points[:4].tolist() == [[0, 2, 3], [2, 2, 3], [0, 2, 4], [2, 2, 4]]
    assert flat.uv[:4].tolist() == [[0, 0], [1, 0], [0, 1], [1, 1]]
    folded = foliage.Cards(foot, right, up, np.array([(0, -0.5, 0)] * 2)).part()
    assert (len(flat.faces), len(folded.faces)) == (4, 8)
    for part in (flat, folded):
        a, b, c = (part.points[part.faces[:, i]] for i in range(3))
        normal = np.cross(b - a, c - a)
        assert (normal @ np.cross(right[0], up[0]) > 0).all()
        assert np.linalg.norm(normal, axis=1).sum() / 2 >= 4.0 - 1e-9  # m2, more where folded
    assert folded.points[1].tolist() == [1, 1.5, 3]
    assert foliage.Cards(foot, right, up).every(2, 1).foot_m.tolist() == [[0, 0, 0]]


@pytest.mark.parametrize("species", SPECIES)
def test_a_tree_is_wood_and_cut_out_leaves_that_are_no_ball(species: str) -> None:
    plan, surfaces = tree(species)
    assert [s.cut_out for s in surfaces] == [False, True]
    wood, leaves = surfaces
    assert sum(len(s.faces) for s in surfaces) <= 1000
    low, high = leaves.vertices_m.min(axis=0), leaves.vertices_m.max(axis=0)
    assert wood.vertices_m[:, 2].min() == pytest.approx(0, abs=1e-6)
    assert 0.85 * plan.height_m < high[2] < 1.15 * plan.height_m
    if species == "conifer":
        foot = leaves.vertices_m[leaves.vertices_m[:, 2] < 1.6]
        assert np.hypot(*foot[:, :2].T).max(initial=0) < 1.05 * plan.canopy_radius_m
    else:
        assert low[2] > 1.6  # robots pass below
    assert (high - low)[:2].max() < 3.6 * plan.canopy_radius_m

    # Leaves fill the crown rather than cover one smooth shell, and leave air between them.
    middle = leaves.vertices_m[leaves.faces].mean(axis=1)
    out = middle - middle.mean(axis=0)
    out /= out.std(axis=0)
    distance = np.linalg.norm(out, axis=1)
    assert distance.std() / distance.mean() > 0.15  # of a ball of triangles: below 0.1
    assert (leaves.texture[..., 3] < OPAQUE).mean() > 0.25


@pytest.mark.parametrize("species", SPECIES)
def test_every_tree_is_its_own_and_the_same_every_time(species: str) -> None:
    for a, b, c in zip(tree(species)[1], tree(species)[1], tree(species, seed=1)[1], strict=True):
        assert np.array_equal(a.vertices_m, b.vertices_m) and np.array_equal(a.texture, b.texture)
        assert a.texture.tobytes() != c.texture.tobytes()


def test_bushes_and_hedges_have_ragged_rims() -> None:
    for surfaces in (
        plants.build_bush(1.2, generator(0, "bush")),
        plants.build_hedge(6.0, False, generator(0, "hedge")),
    ):
        body, leaves = surfaces
        assert not body.cut_out and leaves.cut_out
        assert leaves.vertices_m[:, 2].max() > body.vertices_m[:, 2].max() + 0.03
        assert min(s.vertices_m[:, 2].min() for s in surfaces) == pytest.approx(0, abs=1e-6)
