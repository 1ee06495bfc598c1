"""No two houses look alike: what a recogniser of landmarks learns, it learns from these."""

from collections import Counter

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vrchain.seeding import generator
from vrchain.world import drawing
from vrchain.world.buildings import barn, facades, houses, plans, shops
from vrchain.world.buildings.plans import HousePlan
from vrchain.world.model import Surface

SEEDS = (2000, 3000)
N = 32  # houses of a suburb


def plan_of(seed: int, index: int) -> HousePlan:
    return plans.draw_house(generator(seed, "house", index, "plan"), 0.35)


def house(seed: int, index: int) -> Surface:
    """House ``index`` of a suburb as it is built there."""
    return houses.build(plan_of(seed, index), generator(seed, "house", index), index)[0]


def front(surface: Surface) -> NDArray[np.float32]:
    """A small picture of a model from -y, straight on, (20, 32, 3) in Lab."""
    import open3d as o3d

    x, z = np.meshgrid(np.arange(-8, 8, 1 / 8) + 1 / 16, np.arange(10, 0, -1 / 8) - 1 / 16)
    rays = np.stack([x, 0 * x - 50, z, 0 * x, 0 * x + 1, 0 * x], axis=-1).astype(np.float32)
    caster = o3d.t.geometry.RaycastingScene()
    faces = o3d.core.Tensor(surface.faces.astype(np.uint32))
    caster.add_triangles(o3d.core.Tensor(surface.vertices_m), faces)
    hit = {key: value.numpy() for key, value in caster.cast_rays(o3d.core.Tensor(rays)).items()}
    seen = np.isfinite(hit["t_hit"])
    share = hit["primitive_uvs"][seen]
    a, b, c = surface.uv[surface.faces[hit["primitive_ids"][seen]]].transpose(1, 0, 2)
    u, v = (a + share[:, :1] * (b - a) + share[:, 1:] * (c - a)).T
    rows, columns = surface.texture.shape[:2]
    picture = np.full((*x.shape, 3), 200, dtype=np.uint8)
    picture[seen] = surface.texture[((1 - v) * rows).astype(int), (u * columns).astype(int)]
    small = cv2.resize(picture, (32, 20), interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(small, cv2.COLOR_RGB2LAB).astype(np.float32)


def nearest(pictures: list[NDArray[np.float32]]) -> NDArray[np.float64]:
    """Mean difference of each picture's cells from the picture most like it, in Lab's units."""
    stack = np.array(pictures)
    apart = np.abs(stack[:, None] - stack[None]).mean(axis=(2, 3, 4))
    np.fill_diagonal(apart, np.inf)
    return apart.min(axis=1)


def test_no_two_houses_share_a_plan_or_look_alike() -> None:
    built = [house(seed, index) for seed in SEEDS for index in range(1, N + 1)]
    assert len({s.texture.tobytes() for s in built}) == len(built)
    assert len({plan_of(seed, k) for seed in SEEDS for k in range(1, N + 1)}) == len(built)
    apart = nearest([front(s) for s in built])
    assert apart.min() > 2.0
    assert np.median(apart) > 5.0  # as much as one plan in two styles


def test_the_measure_knows_a_twin_and_a_stranger() -> None:
    one, other = front(house(2000, 2)), front(house(2000, 4))
    assert np.abs(one - front(house(2000, 2))).mean() == 0
    assert np.abs(one - other).mean() > 5
    assert np.abs(one - 200).mean() > 5  # something is drawn


def test_there_are_tens_of_combinations() -> None:
    """Of walls, colours, windows and doors with roofs and plans, over five suburbs."""
    walls, kinds = Counter(), Counter()
    for seed in range(5):
        for k in range(1, N + 1):
            plan = plan_of(seed, k)
            style = facades.random_style(generator(seed, "house", k), k)
            hue = int(np.argmax(style.wall_rgb)), round(sum(style.wall_rgb) / 128)
            door = int(np.argmax(style.door_rgb))
            walls[style.material, style.upper, hue, style.panes, style.shutters, door] += 1
            parts = (plan.garage, plan.wing, plan.chimney, plan.bay, plan.stack_xy_m, plan.dormers)
            kinds[plan.roof, plan.storeys, plan.on_roof, *(bool(part) for part in parts)] += 1
    assert len(walls) > 150  # of 160
    assert len(kinds) > 75
    assert max(kinds.values()) <= 8


def test_shops_have_names_and_fronts_of_their_own() -> None:
    drawn = [plans.draw_shop(generator(seed, "shop", k)) for seed in range(10) for k in (1, 2)]
    assert len({(p.name, p.trade) for p in drawn}) == len(drawn)
    built = [shops.build(p, generator(k, "build"))[0] for k, p in enumerate(drawn)]
    assert nearest([front(s) for s in built]).min() > 4.0


def test_a_sign_is_as_large_as_its_letters_and_reads() -> None:
    """Lettering covers a good part of its board and stands off it."""
    board = np.full((39, 480, 3), 30, dtype=np.uint8)
    drawing.write(board, "Quilford BAKERY", cv2.FONT_HERSHEY_DUPLEX, (250.0, 250.0, 250.0), 0.7)
    ink = (board > 140).all(axis=2)
    rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
    assert np.ptp(rows) > 0.4 * 39
    assert 1 <= rows.min() < rows.max() <= 37
    assert 5 < columns.min() < columns.max() < 475
    assert abs(columns.min() + columns.max() - 480) < 30  # in the middle


@pytest.mark.parametrize("seed", range(6))
def test_a_barn_stands_within_its_outline(seed: int) -> None:
    plan = plans.draw_barn(np.random.default_rng(seed))
    (surface,) = barn.build(plan, np.random.default_rng(seed))
    points = surface.vertices_m
    assert abs(points[:, 2].min()) < 1e-6
    low = points[points[:, 2] < 1.6][:, :2]
    x0, y0, x1, y1 = plan.outline.bounds
    assert (low >= (x0 - 0.01, y0 - 0.01)).all() and (low <= (x1 + 0.01, y1 + 0.01)).all()
    assert (x0 + x1, y0 + y1) == pytest.approx((0, 0), abs=1e-9)
    assert points[:, 2].max() > plan.wall_m + 2.0


def test_no_two_barns_look_alike() -> None:
    rngs = [generator(seed, "barn") for seed in range(12)]
    built = [barn.build(plans.draw_barn(rng), rng)[0] for rng in rngs]
    assert nearest([front(s) for s in built]).min() > 4.0
