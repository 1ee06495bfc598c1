import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vrchain.landmarks.matching.photos import claims_of, described, photo_landmarks, sky_mask
from vrchain.seeding import generator

Image = NDArray[np.uint8]
WIDE, HIGH, HORIZON = 1000, 700, 330
SKIES = {
    "white on blue": ((80, 130, 200), (245, 245, 250)),
    "overcast": ((130, 133, 140), (225, 226, 230)),
    "grey on blue": ((60, 95, 170), (200, 205, 225)),
}


def clouds(kind: str, seed: int = 0) -> NDArray[np.float32]:
    """Smooth noise, finer and fainter by the octave, between the two colours of a sky."""
    draws, height = generator(seed, "clouds", kind), np.zeros((HIGH, WIDE), np.float32)
    for octave in range(4):
        coarse = draws.normal(size=(10 << octave, 14 << octave)).astype(np.float32)
        height += 0.5**octave * cv2.resize(coarse, (WIDE, HIGH), interpolation=cv2.INTER_CUBIC)
    share = 1 / (1 + np.exp(-3 * height / height.std()))[..., None]
    low, high = (np.array(rgb, np.float32) for rgb in SKIES[kind])
    return low + (high - low) * share


def bricks(name: str, width: int, height: int) -> Image:
    """Rectangles of all sizes and colours, one over the other."""
    image, draws = np.full((height, width, 3), 90, np.uint8), generator(0, "bricks", name)
    for _ in range(width * height // 600):
        x, y = draws.integers(-20, (width, height))
        wide, high = draws.integers(8, 70, 2)
        colour = draws.integers(0, 200, 3).tolist()
        cv2.rectangle(image, (int(x), int(y)), (int(x + wide), int(y + high)), colour, -1)
    return image


def outdoors(name: str, sky: NDArray[np.float32], shift: int = 0, top: int = 120) -> Image:
    """A street of houses of its own below a sky that has moved on by some pixels."""
    image, draws = np.roll(sky, shift, axis=1), generator(0, "street", name)
    image[HORIZON:] = bricks(name, WIDE, HIGH - HORIZON)
    for k, left in enumerate(range(40, WIDE - 200, 320)):
        high = top if k == 1 else int(draws.integers(200, 280))
        image[high:HORIZON, left : left + 200] = bricks(f"{name} {k}", 200, HORIZON - high)
    noise = generator(shift, "noise", name).normal(0, 2, (HIGH, WIDE, 1))
    return np.clip(image + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("kind", SKIES)
def test_where_clouds_have_moved_only_the_street_below_is_common(kind: str) -> None:
    sky = clouds(kind)
    assert photo_landmarks(outdoors("here", sky), outdoors("there", sky, 30)) == ()
    claims = photo_landmarks(outdoors("here", sky), outdoors("here", sky, 60))
    solid = outdoors("here", np.full((HIGH, WIDE, 3), -50, np.float32)).any(axis=2)
    assert claims
    for region in (side for claim in claims for side in (claim.a, claim.b)):
        x0, y0, x1, y1 = map(int, region.box_px)
        assert solid[y0:y1, x0:x1].mean() > 0.5


def test_a_tower_that_reaches_the_upper_edge_keeps_what_it_has() -> None:
    image = outdoors("here", clouds("white on blue"), top=0)
    mask = sky_mask(image)
    assert mask[:100].mean() > 0.75
    assert mask[HORIZON:].mean() < 0.1 and mask[:, 365:555].mean() < 0.1
    found = described(image)
    x_px, y_px = found.keypoints.xy_px.T
    tower = (np.abs(x_px - 460) < 95) & (y_px < HORIZON)
    assert tower.sum() > 100 and found.in_sky[tower].mean() < 0.06
    assert claims_of(found, described(outdoors("here", clouds("overcast"), top=0)))


def test_a_picture_without_sky_has_none() -> None:
    assert sky_mask(bricks("wall", WIDE, HIGH)).mean() < 0.05
