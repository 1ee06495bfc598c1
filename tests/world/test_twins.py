"""Twins on demand: houses and vehicles that repeat a model, as real streets do."""

from dataclasses import replace

import numpy as np
import pytest
from suburbs import digest, too_close

from vrchain.world import Scene, Surface, build_scene
from vrchain.world.atlas import join_by_texture
from vrchain.world.spec import parse_spec
from vrchain.world.suburb.layout import draw_layout
from vrchain.world.suburb.site import repeats

NOTHING = dict.fromkeys(("mailboxes", "lamps", "poles", "signs", "bins", "hydrants"), 0)
HAMLET = parse_spec(
    {
        "seed": 3,
        "extent_m": [110, 110],
        "houses": {"count": 10},
        "trees": {"count": 5},
        "vehicles": {"count": 8},
        "boundaries": {"fences": 4, "walls": 2, "hedges": 2},
        "furniture": {**NOTHING, "bushes": 2},
    }
)


@pytest.fixture(scope="module")
def street() -> Scene:
    return build_scene(replace(HAMLET, twins=0.5))


def area_m2(surface: Surface) -> float:
    a, b, c = (surface.vertices_m[surface.faces[:, k]].astype(float) for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 1.0])
def test_the_share_of_twins_is_as_asked_of_houses_and_vehicles_alone(share: float) -> None:
    by_name = {p.name: p for p in draw_layout(replace(HAMLET, twins=share)).placements}
    repeated = [p for p in by_name.values() if p.model != p.name]
    for kind, count in (("house", 10), ("vehicle", 8)):
        assert sum(p.kind == kind for p in by_name.values()) == count
        twins = sum(p.kind == kind for p in repeated)
        assert twins == min(round(share * count), count - 1)  # the first repeats nothing
    for p in repeated:
        assert p.kind in ("house", "vehicle")
        assert by_name[p.model].model == p.model
        assert by_name[p.model].plan == p.plan


def test_twins_show_the_same_mesh_and_the_same_picture(street: Scene) -> None:
    first = {o.name: o for o in street.objects}
    twins = [o for o in street.objects if o.model != o.name]
    assert len(twins) == 5 + 4
    for twin in twins:
        model = first[twin.model]
        assert (twin.kind, twin.size_m) == (model.kind, model.size_m)
        for a, b in zip(twin.surfaces, model.surfaces, strict=True):
            assert a.texture is b.texture  # so that an atlas holds it once
            assert area_m2(a) == pytest.approx(area_m2(b), rel=1e-5)  # cut finer, for the light
    houses = [s for o in street.objects if o.kind in ("house", "vehicle") for s in o.surfaces]
    assert len(join_by_texture(houses)) == 5 + 4
    assert too_close([o for o in street.objects if o.solid]) == []


def test_no_twins_is_the_same_as_leaving_the_option_out() -> None:
    assert parse_spec({}) == parse_spec({"twins": 0})
    bare = build_scene(HAMLET)
    assert [o.name for o in bare.objects] == [o.model for o in bare.objects]
    # An option so small that nothing is repeated changes not a byte either.
    none = build_scene(replace(HAMLET, twins=1e-6))
    assert digest(none) == digest(bare)
    assert none.table.equals(bare.table)


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_repeats_name_earlier_originals(count: int) -> None:
    for share in (0.0, 0.3, 1.0):
        found = repeats(count, share, np.random.default_rng(1))
        assert len(found) == max(0, min(round(share * count), count - 1))
        assert all(original < twin and original not in found for twin, original in found.items())
