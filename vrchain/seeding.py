"""One seed, many independent generators, each known by its name.

A generator depends on the seed and its own name only, so a new random object
somewhere never changes the draws of another.
"""

import hashlib
from operator import index

import numpy as np

from vrchain.errors import SeedError


def generator(seed: int, *names: str | int) -> np.random.Generator:
    """The generator of the object ``names`` under ``seed`` (any int, 0 like any other).

    SeedError for what is no whole number.
    """
    key = "/".join([str(whole(seed)), *map(str, names)])
    entropy = int.from_bytes(hashlib.sha256(key.encode()).digest(), "big")
    return np.random.Generator(np.random.PCG64(entropy))


def whole(seed: int) -> int:
    """The seed as an int. SeedError for what is no whole number."""
    try:
        return index(seed)
    except TypeError:
        raise SeedError(f"expected a seed that is a whole number, got {seed!r}") from None
