"""One seed, many independent generators, each known by its name.

A generator depends on the seed and its own name only, so a new random object
somewhere never changes the draws of another.
"""

import hashlib

import numpy as np


def generator(seed: int, *names: str | int) -> np.random.Generator:
    """The generator of the object ``names`` under ``seed`` (any int, 0 like any other)."""
    key = "/".join([str(int(seed)), *map(str, names)])
    entropy = int.from_bytes(hashlib.sha256(key.encode()).digest(), "big")
    return np.random.Generator(np.random.PCG64(entropy))
