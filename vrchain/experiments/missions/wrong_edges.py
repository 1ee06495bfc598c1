"""Eyes that are sometimes wrong: what a mission makes of a landmark graph with wrong edges."""

from dataclasses import replace

from vrchain.landmarks.matching.common import Comparison
from vrchain.navigation.perception import Look, Perception
from vrchain.seeding import generator


def misled(perception: Perception, share: float, seed: int) -> Perception:
    """Eyes that, of so many pairs with something in common, say what another pair has in common.

    The claims, scores and relative pose are those of a pair compared before: as sure as any.
    """
    if share == 0:
        return perception
    draws = generator(seed, "wrong edges")
    before: list[Comparison] = []

    def compare(a: Look, b: Look) -> Comparison:
        found = perception.compare(a, b)
        if not found.common:
            return found
        wrong = before and draws.uniform() < share
        said = before[int(draws.integers(len(before)))] if wrong else found
        before.append(found)
        return said

    return replace(perception, compare=compare)
