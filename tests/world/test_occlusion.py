"""How much light gets where, in worlds whose shadows are known."""

import tracemalloc

import numpy as np
import pytest
import worlds
from numpy.typing import NDArray

from vrchain.world import occlusion
from vrchain.world.model import SceneObject
from vrchain.world.occlusion import MARGIN_M, Obstacles, obstacles

EXTENT_M = (40.0, 40.0)
UP = np.array([0.0, 0.0, 1.0])


def towards(azimuth_deg: float, elevation_deg: float) -> NDArray[np.float64]:
    a, e = np.radians([azimuth_deg, elevation_deg])
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def block(
    kind: str, centre: tuple[float, float], size: tuple[float, float, float], base_m: float = 0.0
) -> SceneObject:
    box = worlds.box("it", centre, size, worlds.plain(worlds.RED), base_m=base_m)
    below = worlds.box("it", centre, (*size[:2], 0.01), worlds.plain(worlds.RED), base_m=base_m)
    return SceneObject("it", kind, "it", True, True, box.size_m, (*box.surfaces, *below.surfaces))


def blocked(*things: SceneObject) -> Obstacles:
    return obstacles(things, EXTENT_M, 0.25)


def ground_at(
    things: Obstacles, direction: NDArray[np.float64], *points: tuple[float, float]
) -> list[float]:
    """Shares of light on the ground at places."""
    at = np.array([(x, y, 0.0) for x, y in points], dtype=np.float32)
    return things.arriving(direction, at)[0].tolist()


@pytest.mark.parametrize("azimuth_deg", [0.0, 77.0, 180.0, 235.0])
def test_a_block_throws_its_shadow_as_far_as_the_sun_is_low(azimuth_deg: float) -> None:
    things = blocked(block("box", (0, 0), (2, 2, 3)))
    light = towards(azimuth_deg, 30.0)
    away = -light[:2] / np.hypot(*light[:2])
    reach_m = 3.0 / np.tan(np.radians(30.0))
    places = (tuple(d * away) for d in (1.5 + 0.5 * reach_m, 1.8 + reach_m, -1.9))
    assert ground_at(things, light, *places) == pytest.approx([0, 1, 1], abs=0.02)


def test_the_top_and_the_sunny_side_of_a_block_are_lit_and_its_far_side_is_not() -> None:
    things = blocked(block("box", (0, 0), (2, 2, 3)))
    places = np.array([(0, 0, 3.3), (1.35, 0, 1.5), (-1.35, 0, 1.5)], dtype=np.float32)
    shares, _ = things.arriving(towards(0.0, 40.0), places)
    assert shares.tolist() == pytest.approx([1, 1, 0], abs=0.05)


def test_the_shadow_of_a_pole_has_no_gaps() -> None:
    things = blocked(block("pole", (0.05, 0.05), (0.1, 0.1, 6)))
    light = towards(200.0, 14.0)
    along = np.linspace(1.0, 18.0, 60)
    line = [tuple(0.05 - d * light[:2] / np.hypot(*light[:2])) for d in along]
    assert max(ground_at(things, light, *line)) < 0.75


def test_under_a_table_it_is_dark_and_beside_it_light() -> None:
    things = blocked(block("box", (0, 0), (4, 4, 0.2), base_m=2.0))
    assert ground_at(things, UP, (0, 0), (2.6, 0)) == pytest.approx([0, 1], abs=0.02)
    low = towards(0.0, 20.0)  # comes in from the side
    assert ground_at(things, low, (1.0, 0.0)) == pytest.approx([1], abs=0.02)


def test_leaves_take_the_more_the_thicker_they_are() -> None:
    crowns = [block("tree", (0, 0), (4, 4, 2), 2.0), block("tree", (10, 0), (4, 4, 4), 2.0)]
    thin, thick, none = ground_at(blocked(*crowns), UP, (0.0, 0.0), (10.0, 0.0), (5.0, 0.0))
    assert thick == pytest.approx(thin**2, rel=0.05)  # twice the way
    assert 0.2 < thin < 0.5
    assert none == 1


def test_wider_cells_know_the_same_world() -> None:
    fine = blocked(block("box", (3, 1), (2, 2, 3)), block("tree", (-5, 0), (3, 3, 4)))
    wide = fine.coarser()
    assert (wide.cell_m, wide.shape) == (0.5, (112, 112))
    places = [(3.0, 1.0), (-5.0, 0.0), (0.0, 8.0), (3.0, 5.0)]
    light = towards(30.0, 50.0)
    same = pytest.approx(ground_at(fine, light, *places), abs=0.1)
    assert ground_at(wide, light, *places) == same


def test_with_nothing_there_all_light_arrives() -> None:
    shares, ground = obstacles([], EXTENT_M, 0.5).arriving(towards(10, 20), np.zeros((3, 3), "f4"))
    assert (shares == 1).all()
    assert (ground == 1).all()
    assert ground.shape == (round((40 + 2 * MARGIN_M) / 0.5),) * 2
    none = np.zeros((0, 3), dtype=np.float32)
    assert obstacles([], EXTENT_M, 0.5).arriving(UP, none)[0].shape == (0,)


def test_what_stands_at_the_rim_or_beyond_it_is_no_trouble() -> None:
    things = blocked(block("box", (20, 20), (30, 30, 3)))
    assert ground_at(things, UP, (20, 20), (0, 0)) == pytest.approx([0, 1], abs=0.02)
    assert ground_at(things, towards(0, 12), (500.0, 0.0)) == [1.0]


def test_a_floor_far_wider_than_the_map_takes_little_memory() -> None:
    tracemalloc.start()
    things = blocked(block("box", (0, 0), (2000, 2000, 1)))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 200e6
    assert len(things.cell) == np.prod(things.shape)  # no gap in it
    assert things.top_m.min() == 1.0


def test_what_is_high_above_throws_no_shadow() -> None:
    high = block("box", (0, 0), (2, 2, 3), base_m=90_000.0)
    things = blocked(high, block("box", (5, 0), (2, 2, 300)))
    assert things.top_m.max() <= 101.0
    assert ground_at(things, UP, (0, 0), (5, 0)) == pytest.approx([1, 0], abs=0.05)


def test_few_cells_of_a_wide_map_are_dimmed_as_all_of_them_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    draws = np.random.default_rng(3)
    places, sizes = draws.uniform(-30, 30, (20, 2)), draws.uniform(1, 9, (20, 3))
    kinds = ("house", "tree") * 10
    things = [block(*thing) for thing in zip(kinds, places, sizes, strict=True)]
    grid = obstacles(things, (80.0, 80.0), 0.25)
    points = draws.uniform((-40, -40, 0), (40, 40, 10), (5000, 3)).astype(np.float32)
    all_, ground = grid.arriving(towards(40.0, 30.0), points)
    monkeypatch.setattr(occlusion, "_WIDE_M2", 0.0)
    monkeypatch.setattr(occlusion, "_FEW", 1.0)
    few, few_ground = grid.arriving(towards(40.0, 30.0), points)
    assert few.min() < 0.1 < 0.9 < few.max()
    assert np.allclose(few, all_, atol=3e-4) and np.allclose(few_ground, ground, atol=3e-4)
