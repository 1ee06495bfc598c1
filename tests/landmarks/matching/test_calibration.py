import json
from pathlib import Path

import numpy as np
import pytest

from vrchain.errors import LearnedError
from vrchain.landmarks.matching.calibration import (
    Calibration,
    Worth,
    expected_calibration_error,
    fit,
    load_calibration,
    to_json,
)
from vrchain.seeding import generator


def drawn(n: int, seed: int):
    """Claims whose chance of being right is known: features (n, 2), right (n,), chance (n,)."""
    draws = generator(seed, "claims")
    features = draws.normal(size=(n, 2)) * (1.0, 10.0) + (0.0, 5.0)
    chance = 1 / (1 + np.exp(-(2.0 * features[:, 0] - 0.1 * features[:, 1] + 1.0)))
    return features, draws.random(n) < chance, chance


def test_the_known_chances_are_learned() -> None:
    features, right, _ = drawn(20_000, 0)
    other, _, chance = drawn(1_000, 1)
    assert np.abs(fit(features, right).probability(other) - chance).max() < 0.05


def test_learned_scores_are_calibrated_on_other_claims() -> None:
    features, right, _ = drawn(5_000, 0)
    other, truly, _ = drawn(5_000, 1)
    score = fit(features, right).probability(other)
    assert expected_calibration_error(score, truly) < 0.03
    assert expected_calibration_error(np.full(5_000, 0.99), truly) > 0.2


def test_what_is_always_right_stays_finite() -> None:
    features, right, _ = drawn(200, 0)
    score = fit(features, np.ones_like(right)).probability(features)
    assert np.isfinite(score).all() and (score > 0.8).all()


def test_products_tell_what_no_sign_tells_alone() -> None:
    """Right where two signs agree: by themselves, each is even."""
    signs = np.random.default_rng(2).normal(size=(2, 2_000, 3))
    rightly = signs[..., 0] * signs[..., 1] > 0
    plain, both = (fit(signs[0], rightly[0], products=p) for p in (False, True))
    found_plain, found = (((m.probability(signs[1]) > 0.5) == rightly[1]) for m in (plain, both))
    assert found_plain.mean() < 0.6 and found.mean() > 0.95
    far = both.log_odds(np.array([[1e6, -1e6, 0.0]]))  # taken as far, not as farther
    assert np.isfinite(far).all() and abs(far[0]) < 100


def test_written_and_read_again(tmp_path: Path) -> None:
    features, right, _ = drawn(500, 0)
    known = Calibration(12.0, 0.7, {"cnn": Worth(*[fit(features, right, products=True)] * 5)})
    (tmp_path / "w.json").write_text(json.dumps({"calibration": to_json(known)}))
    again = load_calibration(tmp_path / "w.pt")
    assert (again.alike_scale, again.alike_even) == (12.0, 0.7)
    for what in ("poses", "claims", "joined", "settled", "groups"):
        before, after = (getattr(c.of("cnn"), what).probability(features) for c in (known, again))
        assert (before == after).all()
    with pytest.raises(LearnedError, match=r"'sift'.*there is cnn"):
        again.of("sift")


@pytest.mark.parametrize("content", [None, "", "[]", "{}", '{"calibration": {"worth": 3}}'])
def test_no_calibration_is_said_plainly(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "w.json").write_text(content)
    with pytest.raises(LearnedError, match="vrchain train"):
        load_calibration(tmp_path / "w.pt")
