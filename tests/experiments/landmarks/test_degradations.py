import numpy as np
import pytest
from worlds import SMALL_RIG, yard

from vrchain.experiments.landmarks.degradations import (
    Degradation,
    blurred,
    compressed,
    exposed,
    noisy,
    sunflare,
    unchanged,
)
from vrchain.geometry import Pose
from vrchain.panorama import Panorama
from vrchain.seeding import generator
from vrchain.world.render import Renderer

EVERY = [unchanged, blurred, noisy, exposed(0.5), exposed(2.0), sunflare, compressed]


@pytest.fixture(scope="module")
def drawn() -> Panorama:
    return Renderer(yard()).render(Pose(0.0, 0.0), SMALL_RIG)


def grey(level: int) -> Panorama:
    rig = SMALL_RIG
    return Panorama(rig, np.full((8, rig.height_px, rig.width_px, 3), level, dtype=np.uint8))


@pytest.mark.parametrize("spoil", EVERY)
def test_the_same_draws_give_the_same_picture_and_leave_the_given_one(
    spoil: Degradation, drawn: Panorama
) -> None:
    before = drawn.views.copy()
    one, again = (spoil(drawn, generator(5, "spoilt")) for _ in range(2))
    assert np.array_equal(one.views, again.views) and np.array_equal(drawn.views, before)
    assert one.rig == drawn.rig
    assert np.array_equal(one.views, before) == (spoil is unchanged)


def test_noise_has_its_deviation() -> None:
    off = noisy(grey(128), generator(0)).views.astype(float) - 128
    assert off.std() == pytest.approx(20, rel=0.01) and abs(off.mean()) < 0.1


def test_a_blur_is_as_wide_as_it_is_said_to_be() -> None:
    line = grey(0)
    line.views[0, :, 80] = 255
    spread = blurred(line, generator(0)).views[0, ..., 0].astype(float)
    along = spread.sum(axis=0) / spread.sum()
    assert np.sqrt(((np.arange(160) - 80) ** 2 * along).sum()) == pytest.approx(2, abs=0.2)


@pytest.mark.parametrize(("times", "level", "found"), [(0.5, 200, 146), (2.0, 100, 137)])
def test_light_is_doubled_and_halved(times: float, level: int, found: int) -> None:
    assert np.unique(exposed(times)(grey(level), generator(0)).views).tolist() == [found]
    assert exposed(2.0)(grey(250), generator(0)).views.min() == 255


def test_the_sun_is_one_white_disc_and_veils_its_side_alone() -> None:
    """Wherever it stands, a view or two show the disc, and the far side stays as it was."""
    found = sunflare(grey(60), generator(3)).views[..., 0]
    rays = SMALL_RIG.ray_directions()
    white = rays[found == 255]
    middle = white.mean(axis=0) / np.linalg.norm(white.mean(axis=0))
    assert len(white) > 20 and (white @ middle > np.cos(0.2)).all()
    assert middle[2] == pytest.approx(0.3 / np.hypot(1, 0.3), abs=0.02)
    behind = found[rays @ middle < -0.9]
    assert behind.max() <= 61
    assert found[rays @ middle > 0.9].min() > 100


def test_jpeg_loses_what_is_fine(drawn: Panorama) -> None:
    off = compressed(drawn, generator(0)).views.astype(float) - drawn.views
    assert 2 < np.abs(off).mean() < 15
