"""Baked light: what times of day differ in, and that nothing but light changes."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
import worlds
from numpy.typing import NDArray

from vrchain.world.light import Light, bake, lit, sunlight
from vrchain.world.model import LightMap, SceneObject
from vrchain.world.spec import LightSpec, parse_spec

TIMES = ("noon", "evening", "overcast")
EXTENT_M = (40.0, 40.0)


def light_of(time: str, **given: float) -> Light:
    return sunlight(parse_spec({"light": {"time": time, **given}}).light)


def house(size_m: float = 8.0) -> SceneObject:
    return worlds.box("house", (0, 0), (size_m, size_m, 5), worlds.plain((200, 200, 200)))


def at(light_map: LightMap, x_m: float, y_m: float) -> NDArray[np.float64]:
    """RGB 0..1 of the ground's light."""
    h, w = light_map.image.shape[:2]
    share = (np.array([x_m, y_m]) - light_map.low_m) / (light_map.high_m - light_map.low_m)
    return light_map.image[int((1 - share[1]) * h), int(share[0] * w)] / 255


def side_light(things: Iterable[SceneObject], normal: tuple[float, float]) -> NDArray[np.float64]:
    """Mean light of the vertices of the box's side that faces so."""
    (box,) = things
    for s in box.surfaces[:4]:
        a, b, c = s.vertices_m[s.faces[0]]
        n = np.cross(b - a, c - a)[:2]
        if n @ normal > 0.9 * np.linalg.norm(n):
            return s.shade.mean(axis=0)
    raise AssertionError(normal)


@pytest.mark.parametrize("time", TIMES)
def test_far_from_everything_the_ground_has_the_light_of_the_open(time: str) -> None:
    light = light_of(time)
    _, ground = bake([house(2.0)], light, (100.0, 100.0))
    assert at(ground, -48, -48) == pytest.approx(light.on(np.array([[0, 0, 1.0]]))[0], abs=0.03)


@pytest.mark.parametrize("time", TIMES)
def test_the_open_is_bright_and_no_corner_is_black(time: str) -> None:
    things, ground = bake([house()], light_of(time), EXTENT_M)
    assert at(ground, -19, -19).mean() > 0.6
    assert min(s.shade.min() for s in things[0].surfaces) > 0.15
    assert max(s.shade.max() for s in things[0].surfaces) <= 1.0
    assert ground.image.min() > 0.15 * 255


@pytest.mark.parametrize("time", ["noon", "evening"])
def test_the_sun_lights_the_side_towards_it_and_throws_a_shadow_on_the_other(time: str) -> None:
    light = light_of(time, sun_azimuth_deg=180.0)  # from the west
    things, ground = bake([house()], light, EXTENT_M)
    assert side_light(things, (-1, 0)).mean() > 1.3 * side_light(things, (1, 0)).mean()
    assert at(ground, 7, 0).mean() < 0.85 * at(ground, -12, 0).mean()


def test_clouds_take_the_shadows_but_not_the_dimness_of_nooks() -> None:
    _, ground = bake([house()], light_of("overcast", sun_azimuth_deg=180.0), EXTENT_M)
    assert at(ground, 7, 0) == pytest.approx(at(ground, -7, 0), abs=0.04)
    assert at(ground, 4.5, 0).mean() < at(ground, 7, 0).mean() < at(ground, 15, 0).mean()


def test_the_evening_is_warm_in_the_sun_and_cool_in_the_shade() -> None:
    things, _ = bake([house()], light_of("evening", sun_azimuth_deg=180.0), EXTENT_M)
    sunny, shady = side_light(things, (-1, 0)), side_light(things, (1, 0))
    assert sunny[0] > 1.3 * sunny[2]
    assert shady[2] > shady[0]


def test_a_shadow_is_soft_at_its_edge() -> None:
    _, ground = bake([house()], light_of("noon", sun_azimuth_deg=180.0), EXTENT_M)
    tip_m = 4 + 5 / np.tan(np.radians(46.0))
    across = np.array([at(ground, tip_m + d, 0).mean() for d in np.arange(-1.5, 1.5, 0.25)])
    steps = np.diff(across)
    assert (steps > -0.01).all()
    assert steps.max() < 0.6 * (across[-1] - across[0])


def test_large_faces_are_cut_and_stay_what_they_were() -> None:
    before = house(12.0)
    (after,), _ = bake([before], light_of("noon"), EXTENT_M)
    for old, new in zip(before.surfaces, after.surfaces, strict=True):
        corners, uv = new.vertices_m[new.faces].astype(float), new.uv[new.faces].astype(float)
        areas = [
            np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
            for c in (old.vertices_m[old.faces].astype(float), corners)
        ]  # turned as before, nothing covered twice
        assert areas[1].sum(axis=0) == pytest.approx(areas[0].sum(axis=0), abs=1e-4)
        old_m2, new_m2 = (np.linalg.norm(a, axis=1).sum() for a in areas)
        assert new_m2 == pytest.approx(old_m2, rel=1e-5)
        edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
        assert edges.max() < 2.3
        # uv is where it was: one affine map takes places on the old face to uv, old and new.
        ones = np.ones((len(old.vertices_m), 1))
        affine, *_ = np.linalg.lstsq(np.hstack([old.vertices_m, ones]), old.uv, rcond=None)
        placed = np.concatenate([corners, np.ones((*corners.shape[:2], 1))], axis=2) @ affine
        assert placed == pytest.approx(uv, abs=1e-5)
        assert new.texture is old.texture


def test_light_changes_shades_and_nothing_else() -> None:
    results = [bake([house(12.0)], light_of(time), EXTENT_M)[0][0] for time in TIMES]
    for other in results[1:]:
        for a, b in zip(results[0].surfaces, other.surfaces, strict=True):
            for name in ("vertices_m", "faces", "uv"):
                assert getattr(a, name).tobytes() == getattr(b, name).tobytes()
            assert not np.array_equal(a.shade, b.shade)


def test_leaves_are_lit_whichever_way_they_are_turned() -> None:
    cut_out = np.full((8, 8, 4), 255, dtype=np.uint8)
    leaf = worlds.quad([(0, 0, 2), (1, 0, 2), (1, 0, 3), (0, 0, 3)], cut_out)
    turned = replace(leaf, faces=leaf.faces[:, ::-1].copy())
    shades = []
    for surface in (leaf, turned):
        tree = SceneObject("tree", "tree", "tree", True, True, (1, 0, 1), (surface,))
        (baked,), _ = bake([tree], light_of("noon"), EXTENT_M)
        shades.append(baked.surfaces[0].shade)
    assert np.array_equal(shades[0], shades[1])


def test_the_builders_own_shade_stays_in_the_light() -> None:
    plain = house()
    dim = replace(plain, surfaces=tuple(replace(s, shade=0.5 * s.shade) for s in plain.surfaces))
    light = light_of("noon")
    full, half = (bake([thing], light, EXTENT_M)[0][0].surfaces for thing in (plain, dim))
    for a, b in zip(full, half, strict=True):
        assert b.shade == pytest.approx(0.5 * a.shade)


def test_alone_in_the_open_a_thing_has_all_the_light_that_its_faces_can_have() -> None:
    light = sunlight(LightSpec())
    top = lit(house(), light).surfaces[-1].shade
    assert top == pytest.approx(np.tile(light.on(np.array([[0, 0, 1.0]])), (4, 1)))


def test_an_empty_place_is_lit_too() -> None:
    things, ground = bake([], light_of("noon"), EXTENT_M)
    assert things == []
    assert (ground.image == ground.image[0, 0]).all()


def test_what_lies_beyond_the_map_is_not_cut() -> None:
    floor = worlds.box("floor", (0, 0), (2000, 2000, 1), worlds.plain((200, 200, 200)))
    (baked,), _ = bake([floor], light_of("noon"), EXTENT_M)
    assert 2000 < sum(len(s.faces) for s in baked.surfaces) < 50_000
