"""Populations: a model again and again, at places of a pattern or drawn at random."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vrchain import seeding
from vrchain.world.gazebo.frames import pose_matrix
from vrchain.world.gazebo.xml import Element

_KINDS = "random", "uniform", "grid", "linear-x", "linear-y", "linear-z"


def spread(population: Element, most: int) -> Iterator[Element]:
    """The models of a <population>, each at its place, at most so many.

    As Gazebo classic places them, but that random places are the same in every run. Raises
    SpecError.
    """
    of = population.find("model") or population.find("include")
    if of is None:
        raise population.error("expected a <model> in it")
    places = _places(population, most)
    turned = pose_matrix(population.find("pose"))
    named = of.words("name") or of.name or population.name
    kept = [child for child in of.children if child.tag not in ("pose", "name")]
    for k, place in enumerate(places @ turned[:3, :3].T + turned[:3, 3]):
        at = " ".join(repr(float(v)) for v in place)
        name = f"{named}_clone_{k}"
        children = [
            replace(of, tag="pose", attributes={}, text=f"{at} 0 0 0", children=[]),
            replace(of, tag="name", attributes={}, text=name, children=[]),
        ]
        attributes = {**of.attributes, "name": name}
        yield replace(of, attributes=attributes, children=[*children, *kept])


def _places(population: Element, most: int) -> NDArray[np.float64]:
    """Places, (n, 3), about the population's pose."""
    kind = population.words("distribution/type") or "random"
    if kind not in _KINDS:
        raise population.error(f"expected a distribution of {', '.join(_KINDS)}, got {kind[:40]!r}")
    if kind == "grid":
        given = population.find("distribution")
        shape = [_count(population, f"distribution/{name}", 1) for name in ("cols", "rows")]
        _check(population, shape[0] * shape[1], most)
        step = (0.5, 0.5, 0.0) if given is None else given.values("step", (0.5, 0.5, 0.0))
        x, y = (s * (np.arange(n) - (n - 1) / 2) for s, n in zip(step, shape, strict=False))
        column, row = np.meshgrid(x, y)
        return np.column_stack([column.ravel(), row.ravel(), np.zeros(column.size)])
    n = _count(population, "model_count", 1)
    _check(population, n, most)
    rng = seeding.generator(0, "population", population.name)
    box, cylinder = population.find("box"), population.find("cylinder")
    if box is not None:
        size = np.array(box.values("size", (1.0, 1.0, 1.0)))
        if kind.startswith("linear-"):
            places = np.zeros((n, 3))
            axis = "xyz".find(kind[7:])
            places[:, axis] = size[axis] * (np.arange(n) / n - 0.5)
            return places
        return (_shares(kind, n, rng) - 0.5) * size
    if cylinder is None:
        raise population.error("expected a <box> or a <cylinder> to fill")
    turn, out, up = _shares(kind, n, rng).T
    out = cylinder.number("radius", 1.0) * (np.sqrt(out) if kind == "uniform" else out)
    turn, up = 2 * np.pi * turn, up * cylinder.number("length", 1.0)
    return np.column_stack([out * np.cos(turn), out * np.sin(turn), up])


def _shares(kind: str, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Places in the unit cube, (n, 3): at random, or evenly spread (Halton's sequence)."""
    if kind != "uniform":
        return rng.random((n, 3))
    from scipy.stats import qmc

    return np.asarray(qmc.Halton(3, rng=rng).random(n))


def _count(population: Element, path: str, default: int) -> int:
    value = population.number(path, default)
    if value != int(value) or value < 1:
        raise population.error(f"expected a whole number above 0 for <{path}>, got {value:g}")
    return int(value)


def _check(population: Element, n: int, most: int) -> None:
    if n > most:
        raise population.error(f"expected at most {most} models, got {n}")
