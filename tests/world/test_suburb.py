"""The suburb of ``scenes/suburb.yaml``: what is in it, how it stands, and that it has one seed."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from suburbs import (
    GROUND,
    SUBURB,
    asked_for,
    digest,
    ground_digest,
    printed_by_a_fresh_process,
    small,
    too_close,
)

from vrchain.errors import SpecError
from vrchain.experiments.processors import PROCESSORS
from vrchain.geometry import Pose
from vrchain.seeding import generator
from vrchain.world import Scene, SceneObject, build_scene, load_scene, load_spec
from vrchain.world.spec import SceneSpec, parse_spec
from vrchain.world.suburb.layout import draw_layout
from vrchain.world.suburb.site import Candidate
from vrchain.world.suburb.streets import START_XY_M, TURNING_M, draw_streets

BUILDINGS = ("house", "shop", "barn")


@pytest.fixture(scope="module")
def suburb() -> Scene:
    from vrchain.experiments.reproduction import results

    return results.suburb()  # shared with other tests


def triangles(thing: SceneObject) -> NDArray[np.float64]:
    """Of what is opaque: cut-outs are seen from both sides."""
    solid = [s.vertices_m[s.faces] for s in thing.surfaces if not s.cut_out]
    return np.concatenate(solid).astype(float)


def normals(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def pictures(scene: Scene) -> list[bytes]:
    return [s.texture.tobytes() for o in scene.objects if o.landmark for s in o.surfaces]


def test_it_has_what_its_spec_asks_for(suburb: Scene) -> None:
    counts, asked = suburb.table["kind"].value_counts().to_dict(), asked_for(load_spec(SUBURB))
    assert {kind: counts[kind] for kind in asked} == asked
    assert set(counts) == set(asked) | GROUND
    least = {"house": 25, "shop": 3, "barn": 1, "tree": 60, "vehicle": 15}
    assert all(asked[kind] >= n for kind, n in least.items())
    assert suburb.extent_m == (130.0, 180.0)


def test_every_thing_is_a_landmark_of_its_own_that_stands_on_the_ground(suburb: Scene) -> None:
    assert suburb.table["name"].is_unique
    assert (suburb.table["model"] == suburb.table["name"]).all()
    assert len(set(pictures(suburb))) == len(pictures(suburb))
    for thing in suburb.objects:
        assert thing.landmark == thing.solid == (thing.kind not in GROUND), thing.name
        assert not thing.solid or abs(thing.bounds_m[0, 2]) < 0.02, thing.name
    runs = suburb.table[suburb.table["kind"].isin(["fence", "wall", "hedge"])]
    assert runs[["size_x_m", "size_y_m"]].max(axis=None) <= 8.0


def test_no_two_solid_things_overlap_and_all_stand_on_the_map(suburb: Scene) -> None:
    solids = [o for o in suburb.objects if o.solid]
    assert too_close(solids) == []
    on_map = shapely.box(-65, -90, 65, 90)
    assert [o.name for o in solids if not on_map.contains(o.footprint)] == []


def test_flat_ground_is_flat_and_covers_the_map_once(suburb: Scene) -> None:
    area = 0.0
    for thing in suburb.objects:
        if thing.kind in GROUND - {"backdrop"}:
            corners = triangles(thing)
            assert np.abs(corners[:, :, 2]).max() == 0.0
            doubled = normals(corners)[:, 2]
            assert doubled.min() > -1e-4, "the ground has to be seen from above"
            area += doubled.sum() / 2
    assert area == pytest.approx(330.0 * 380.0, rel=1e-6)


def test_the_first_surface_that_a_look_meets_faces_it(suburb: Scene) -> None:
    """Rays from all around: what they hit first must not be the back of a face."""
    import open3d as o3d

    kinds = (*BUILDINGS, "vehicle", "fence", "wall", "hedge", "lamp", "mailbox", "bin", "pole")
    for thing in [o for k in kinds for o in [o for o in suburb.objects if o.kind == k][:6]]:
        corners = triangles(thing).astype(np.float32)
        caster = o3d.t.geometry.RaycastingScene()
        faces = np.arange(len(corners) * 3, dtype=np.uint32).reshape(-1, 3)
        caster.add_triangles(o3d.core.Tensor(corners.reshape(-1, 3)), o3d.core.Tensor(faces))
        low, high = thing.bounds_m
        rng = np.random.default_rng(0)
        aim = rng.uniform(low, high, (4000, 3))
        away = rng.normal(size=(4000, 3))
        away[:, 2] = np.abs(away[:, 2]) * 0.3  # from the side or from above, as a robot looks
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        start = (low + high) / 2 + 2 * np.linalg.norm(high - low) * away
        rays = np.concatenate([start, aim - start], axis=1).astype(np.float32)
        hit = caster.cast_rays(o3d.core.Tensor(rays))
        seen = np.isfinite(hit["t_hit"].numpy())
        towards = np.einsum("ij,ij->i", hit["primitive_normals"].numpy(), rays[:, 3:]) < 0
        assert towards[seen].mean() > 0.995, thing.name
        assert seen.sum() > 50


def test_doors_are_at_the_foot_of_facades(suburb: Scene) -> None:
    """On every upright face of a building, v rises with z, and u to the right as one looks at it:
    pictures are the right way up and not mirrored, and lettering can be read."""
    for thing in [o for o in suburb.objects if o.kind in BUILDINGS]:
        for s in thing.surfaces:
            corners = s.vertices_m[s.faces].astype(float)
            normal = normals(corners)
            size = np.linalg.norm(normal, axis=1)
            facade = (np.abs(normal[:, 2]) < 0.05 * size) & (size > 0.8)  # no roof's edge board
            assert facade.sum() >= 8
            right = np.stack([-normal[facade, 1], normal[facade, 0]], axis=1)
            along = np.einsum("ijk,ik->ij", corners[facade, :, :2], right)
            uv = s.uv[s.faces[facade]].astype(float)
            uv -= uv.mean(axis=1, keepdims=True)
            for place, picture in ((corners[facade, :, 2], uv[..., 1]), (along, uv[..., 0])):
                rises = ((place - place.mean(axis=1, keepdims=True)) * picture).sum(axis=1)
                assert (rises > 0).all(), thing.name


def test_arrays_are_what_a_renderer_takes(suburb: Scene) -> None:
    assert suburb.sky is not None
    surfaces = [s for o in suburb.objects for s in o.surfaces] + [suburb.sky]
    for s in surfaces:
        n = len(s.vertices_m)
        assert (s.vertices_m.dtype, s.uv.dtype, s.shade.dtype) == (np.float32,) * 3
        assert (s.faces.dtype, s.texture.dtype) == (np.int32, np.uint8)
        assert s.uv.shape == (n, 2)
        assert s.shade.shape in ((n,), (n, 3))
        assert 0 <= s.faces.min() <= s.faces.max() < n
        assert np.isfinite(s.vertices_m).all() and np.isfinite(s.uv).all()
        assert 0.1 < s.shade.min() <= s.shade.max() <= 1  # no side is black
    assert sum(len(s.faces) for s in surfaces) < 140_000
    assert sum(s.texture.nbytes for s in surfaces) < 70e6


def test_the_sky_is_seen_from_inside(suburb: Scene) -> None:
    assert suburb.sky is not None
    corners = suburb.sky.vertices_m[suburb.sky.faces].astype(float)
    normal = normals(corners)
    proper = np.linalg.norm(normal, axis=1) > 1e-3
    inward = -np.einsum("ij,ij->i", normal, corners.mean(axis=1))
    assert (inward[proper] > 0).all()


def test_a_robot_gets_everywhere(suburb: Scene) -> None:
    axes = [np.arange(-e / 2 + 0.5, e / 2, 0.5) for e in suburb.extent_m]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    free = suburb.is_free(points.reshape(-1, 2)).reshape(points.shape[:2])
    parts, _ = ndimage.label(free)
    main = parts == 1 + np.bincount(parts.ravel())[1:].argmax()  # the largest connected part
    assert main.sum() / free.sum() > 0.995
    assert main.mean() > 0.7  # most of the map is free to drive
    assert all(edge.any() for edge in (main[0], main[-1], main[:, 0], main[:, -1]))
    suburb.check_pose(Pose(10.0, 0.0))
    assert suburb.clearance_m([(10.0, 0.0)])[0] > 1.0


def test_one_seed_gives_the_same_bytes_in_a_fresh_process(suburb: Scene) -> None:
    code = (
        "print(digest(build_scene(load_spec(SUBURB))), digest(small('evening', 'autumn')),"
        " digest(small('overcast', 'winter')))"
    )
    here = [suburb, small("evening", "autumn"), small("overcast", "winter")]
    assert printed_by_a_fresh_process(code).split() == [digest(scene) for scene in here]


def test_ground_is_cut_alike_by_other_processors() -> None:
    code = "print(ground_digest())"
    assert printed_by_a_fresh_process(code, **PROCESSORS["AVX2"]) == ground_digest()


def test_light_and_season_change_colours_and_nothing_else() -> None:
    usual = small("noon", "summer")
    looks = {digest(usual)}
    for time, season in (("evening", "summer"), ("overcast", "winter"), ("noon", "spring"),
                         ("noon", "autumn")):  # fmt: skip
        other = small(time, season)
        assert other.table.equals(usual.table)
        for a, b in zip(usual.objects, other.objects, strict=True):
            for s, t in zip(a.surfaces, b.surfaces, strict=True):
                for name in ("vertices_m", "faces", "uv"):
                    assert np.array_equal(getattr(s, name), getattr(t, name)), (a.name, name)
                same = np.array_equal(s.texture, t.texture)
                assert same or a.kind in ("tree", "bush", "hedge", "grass", "backdrop"), a.name
                if s.cut_out:
                    assert np.array_equal(s.texture[..., 3], t.texture[..., 3])
        looks.add(digest(other))
    assert len(looks) == 5


def test_another_seed_gives_another_suburb(suburb: Scene) -> None:
    other = load_scene(SUBURB, seed=3000)
    assert digest(other) != digest(suburb)
    assert set(pictures(other)).isdisjoint(pictures(suburb))
    streets = [draw_layout(replace(load_spec(SUBURB), seed=s)).streets for s in (2000, 3000)]
    assert streets[0].road.symmetric_difference(streets[1].road).area > 500.0
    columns = ["centre_x_m", "centre_y_m"]
    houses = [s.table[s.table["kind"] == "house"][columns].round(2) for s in (suburb, other)]
    assert set(map(tuple, houses[0].to_numpy())).isdisjoint(map(tuple, houses[1].to_numpy()))


MANY = (pytest.param(seed, marks=pytest.mark.slow) for seed in range(2000, 2030))


@pytest.mark.parametrize("seed", [0, 1, 3001, 3002, 10_000, *MANY])
def test_every_seed_finds_room_for_everything(seed: int) -> None:
    spec = replace(load_spec(SUBURB), seed=seed)
    layout = draw_layout(spec)
    assert Counter(p.kind for p in layout.placements) == asked_for(spec)
    assert layout.streets.road.contains(shapely.Point(START_XY_M).buffer(1.5))
    standing = [Candidate(p.pose, p.plan.outline).ground for p in layout.placements
                if p.kind in BUILDINGS]  # fmt: skip
    assert shapely.union_all(standing).distance(layout.streets.corridor) > 0.3
    for p in layout.placements:
        if p.kind in ("lamp", "hydrant", "pole", "sign", "mailbox"):
            assert layout.streets.road.distance(shapely.Point(p.pose.xy_m)) > 0.2, p.name


def test_streets_differ_from_seed_to_seed_and_dead_ends_have_turning_circles() -> None:
    """In how many run along x and along y, in junctions and dead ends, not in places alone."""
    patterns: Counter[tuple[int, ...]] = Counter()
    ends = 0
    for seed in range(40):
        streets = draw_streets(SceneSpec(), generator(seed, "streets"))
        headings = [s.at(sum(s.on_map_m) / 2).yaw_rad for s in streets.lines]
        along_x = sum(abs(np.cos(h)) > 0.7 for h in headings)
        patterns[len(headings), along_x, len(streets.junctions), len(streets.heads)] += 1
        for street in [s for s in streets.lines if s.head is not None]:
            ends += 1
            last = shapely.Point(street.line.coords[-1])
            assert street.head.equals(last)
            assert streets.road.contains(last.buffer(streets.width_m / 2 + TURNING_M - 0.1))
            assert street.on_map_m[1] < street.line.length - streets.half_m
            assert all(last.distance(p) > 15 for p in streets.junctions)
    assert len(patterns) >= 8
    assert max(patterns.values()) <= 20
    assert ends >= 8


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("houses: {count: 60}", "houses.count"),
        ("shops: {count: 30}", "houses.count"),
        ("houses: {count: 0}\nshops: {count: 40}\nbarns: {count: 20}", "shops.count"),
        ("vehicles: {count: 300}", "vehicles.count"),
        ("furniture: {mailboxes: 100}", "furniture.mailboxes"),
        ("boundaries: {fences: 800}", "boundaries.fences"),
    ],
)
def test_more_than_fits_is_refused_with_what_would(tmp_path: Path, text: str, key: str) -> None:
    path = tmp_path / "crowded.yaml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SpecError, match=rf"{key}.*allowed here 0\.\.\d+"):
        load_scene(path)


def test_an_empty_field_is_a_scene_too() -> None:
    asked = load_spec(SUBURB)
    none = {k: {"count": 0} for k in ("houses", "shops", "barns", "trees", "vehicles")}
    for part in ("boundaries", "furniture"):
        none[part] = dict.fromkeys(vars(getattr(asked, part)), 0)
    scene = build_scene(parse_spec({"extent_m": [60, 60], **none}))
    assert set(scene.table["kind"]) <= GROUND
