import numpy as np
import pytest
import worlds
from hypothesis import given
from hypothesis import strategies as st

from vrchain.errors import SeedError
from vrchain.seeding import generator

SEEDS = st.integers(-(2**70), 2**70)


@given(SEEDS, st.text(max_size=10))
def test_the_same_name_draws_the_same(seed: int, name: str) -> None:
    first, second = (generator(seed, name, 3).uniform(size=4) for _ in range(2))
    assert np.array_equal(first, second)


@given(SEEDS, SEEDS, st.text("abc", max_size=3), st.text("abc", max_size=3))
def test_another_seed_or_name_draws_otherwise(
    seed: int, other: int, name: str, another: str
) -> None:
    same = (seed, name) == (other, another)
    draws = [generator(s, n).integers(0, 2**62, 2) for s, n in ((seed, name), (other, another))]
    assert np.array_equal(*draws) == same


def test_every_seed_and_every_order_of_names_draws_otherwise() -> None:
    """Seed 0 and negative ones are seeds like any other, numbers are names."""
    orders = (("a", "b"), ("b", "a"), ("a",), (), ("a", 1), ("a", 11), ("a", 1, 1))
    asked = [*((0, names) for names in orders), *((seed, ("x",)) for seed in (0, 1, -1, 2**64))]
    draws = {int(generator(seed, *names).integers(0, 2**62)) for seed, names in asked}
    assert len(draws) == len(asked)
    assert generator(np.int64(7), "x").uniform() == generator(7, "x").uniform()


def test_a_new_generator_does_not_disturb_another() -> None:
    one = generator(5, "one")
    first = one.uniform(size=3)
    generator(5, "two").uniform(size=100)
    np.random.default_rng(0).uniform(size=3)
    again = generator(5, "one")
    assert np.array_equal(again.uniform(size=3), first)
    assert np.array_equal(again.uniform(size=3), one.uniform(size=3))


@pytest.mark.parametrize("bad", ["seven", "7", None, 1.5, float("nan")])
def test_what_is_no_whole_number_is_no_seed(bad: object) -> None:
    with pytest.raises(SeedError, match="a whole number, got"):
        generator(bad, "x")


def test_two_processes_draw_the_same() -> None:
    code = """
import json
from vrchain.seeding import generator
print(json.dumps([int(generator(s, n, 2).integers(0, 2**62)) for s in (0, -5) for n in "aä"]))
"""
    first, second = worlds.in_two_processes(code)
    assert first == second and len(set(first)) == 4
