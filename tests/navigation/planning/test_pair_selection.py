from itertools import combinations

import pytest

from vrchain.navigation.planning.pair_selection import bridges, partners


def test_few_are_all_compared_and_of_many_each_with_the_next_and_the_most_alike() -> None:
    few = ["R1", "R2", "R3~1", "R3"]
    assert partners(few, []) == list(combinations(few, 2))
    many = [f"R{r}~{k}" for k in range(9, -1, -1) for r in (2, 3)]
    alike = sorted(combinations(many, 2), key=lambda p: abs(int(p[0][3:]) - int(p[1][3:])))
    chosen = partners(many, alike)
    assert len(chosen) == len(set(chosen)) < len(alike) / 2
    assert [p for p in combinations(many, 2) if p in chosen] == chosen  # in the order of names
    for robot in ("R2", "R3"):
        for k in range(9, 0, -1):
            assert (f"{robot}~{k}", f"{robot}~{k - 1}") in chosen
    assert all((f"R2~{k}", f"R3~{k}") in chosen for k in range(10))


@pytest.mark.parametrize("true_joins", [{("h", "x"), ("x", "y"), ("y", "g")}, {("h", "g")}])
def test_bridges_are_looked_for_until_robot_and_goal_hang_together(
    true_joins: set[tuple[str, str]],
) -> None:
    """The pair in the middle looks most alike, but helps only once one of its ends is joined."""
    names = ["h", "x", "y", "g"]
    left = [("x", "y"), ("h", "x"), ("y", "g"), ("h", "y"), ("x", "g"), ("h", "g")]
    rights: dict[tuple[str, str], float] = {}
    asked = []
    for pair in bridges(names, left, rights, {"h"}, {"g"}):
        asked.append(pair)
        rights[pair] = 0.9 if pair in true_joins else 0.0
    assert true_joins <= set(asked) and len(asked) == len(set(asked))
    assert (len(asked) == 3) == (len(true_joins) == 3)  # then nothing more needs asking


def test_what_does_not_hang_together_ends_too() -> None:
    rights: dict[tuple[str, str], float] = {}
    left = list(combinations("hxyg", 2))
    for pair in bridges(list("hxyg"), left, rights, {"h"}, {"g"}):
        rights[pair] = 0.0
    assert ("x", "y") not in rights and len(rights) == 5
