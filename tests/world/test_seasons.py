"""Colours of leaves and grass over the year."""

import colorsys

import pytest

from vrchain.world import seasons
from vrchain.world.textures import Colour, hsv

GREENS = [hsv(hue, s, v) for hue in (55, 80, 118) for s in (0.3, 0.7) for v in (0.4, 0.78)]
RED = hsv(335, 0.5, 0.6)


def hue(colour: Colour) -> float:
    return 360 * colorsys.rgb_to_hsv(*(c / 255 for c in colour))[0]


@pytest.mark.parametrize("colour", GREENS)
def test_leaves_turn_yellow_to_red_and_then_brown(colour: Colour) -> None:
    assert seasons.leaf(colour, "summer", evergreen=False) == colour
    assert seasons.grass(colour, "summer") == pytest.approx(colour)
    autumn = seasons.leaf(colour, "autumn", evergreen=False)
    winter = seasons.leaf(colour, "winter", evergreen=False)
    spring = seasons.leaf(colour, "spring", evergreen=False)
    assert 0 <= hue(autumn) < 60
    assert 20 < hue(winter) < 45
    assert max(winter) - min(winter) < 0.5 * (max(autumn) - min(autumn))
    assert 50 < hue(spring) < 120
    assert max(spring) > max(colour)
    for season in ("spring", "autumn", "winter"):
        evergreen = seasons.leaf(colour, season, evergreen=True)
        assert hue(evergreen) == pytest.approx(hue(colour), abs=1)


def test_what_is_red_in_summer_blossoms_in_spring_and_is_red_in_autumn() -> None:
    blossom = seasons.leaf(RED, "spring", evergreen=False)
    assert min(blossom) > 150
    assert seasons.leaf(RED, "summer", evergreen=False) == RED
    assert hue(seasons.leaf(RED, "autumn", evergreen=False)) > 345


def test_grass_is_greenest_in_spring_and_palest_in_winter() -> None:
    lawn = hsv(84, 0.5, 0.56)
    hues = [hue(seasons.grass(lawn, s)) for s in ("spring", "summer", "autumn", "winter")]
    assert hues == sorted(hues, reverse=True)
    assert seasons.blooms("summer")
    assert not seasons.blooms("winter")
