"""The suburb of ``scenes/suburb.yaml``: what is in it, how it stands, and that it has one seed."""

import hashlib
import os
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from vrchain.errors import SpecError
from vrchain.experiments.processors import PROCESSORS
from vrchain.experiments.scenes import spec_of
from vrchain.geometry import Pose
from vrchain.paths import ROOT, SCENES
from vrchain.seeding import generator
from vrchain.world import Scene, SceneObject, build_scene, load_scene, load_spec
from vrchain.world.spec import SceneSpec, parse_spec
from vrchain.world.suburb.ground import build_ground
from vrchain.world.suburb.layout import draw_layout
from vrchain.world.suburb.site import Candidate
from vrchain.world.suburb.streets import START_XY_M, TURNING_M, draw_streets

SUBURB = SCENES / "suburb.yaml"
GROUND = {"grass", "road", "kerb", "pavement", "marking", "driveway", "path", "backdrop"}


@pytest.fixture(scope="module")
def suburb() -> Scene:
    from vrchain.experiments.reproduction import results

    return results.suburb()  # shared with other tests


def digest(scene: Scene) -> str:
    """Of every byte that is drawn, and of every name."""
    total = hashlib.sha256()
    sky = [scene.sky] if scene.sky else []
    for name, surfaces in [*((o.name, o.surfaces) for o in scene.objects), ("sky", sky)]:
        total.update(name.encode())
        for s in surfaces:
            for array in (s.vertices_m, s.faces, s.uv, s.shade, s.texture):
                total.update(np.ascontiguousarray(array).tobytes())
    if scene.ground_light is not None:
        total.update(scene.ground_light.image.tobytes())
    return total.hexdigest()


def triangles(thing: SceneObject) -> NDArray[np.float64]:
    """Of what is opaque: cut-outs are seen from both sides."""
    solid = [s.vertices_m[s.faces] for s in thing.surfaces if not s.cut_out]
    return np.concatenate(solid).astype(float)


def test_it_has_what_its_spec_asks_for(suburb: Scene) -> None:
    spec = load_spec(SUBURB)
    counts = suburb.table["kind"].value_counts().to_dict()
    asked = {
        "house": spec.houses.count,
        "shop": spec.shops.count,
        "barn": spec.barns.count,
        "tree": spec.trees.count,
        "vehicle": spec.vehicles.count,
        "fence": spec.boundaries.fences,
        "wall": spec.boundaries.walls,
        "hedge": spec.boundaries.hedges,
        "mailbox": spec.furniture.mailboxes,
        "lamp": spec.furniture.lamps,
        "pole": spec.furniture.poles,
        "sign": spec.furniture.signs,
        "bin": spec.furniture.bins,
        "hydrant": spec.furniture.hydrants,
        "bush": spec.furniture.bushes,
    }
    assert {kind: counts[kind] for kind in asked} == asked
    assert set(counts) == set(asked) | GROUND
    assert asked["house"] >= 25
    assert asked["shop"] >= 3
    assert asked["barn"] >= 1
    assert asked["tree"] >= 60
    assert asked["vehicle"] >= 15
    assert suburb.extent_m == (130.0, 180.0)


def test_standing_things_are_landmarks_and_the_ground_is_none(suburb: Scene) -> None:
    for thing in suburb.objects:
        assert thing.landmark == thing.solid == (thing.kind not in GROUND), thing.name


def test_names_are_unique_and_every_design_is_its_own(suburb: Scene) -> None:
    assert suburb.table["name"].is_unique
    assert (suburb.table["model"] == suburb.table["name"]).all()
    pictures = [s.texture.tobytes() for o in suburb.objects if o.landmark for s in o.surfaces]
    assert len(set(pictures)) == len(pictures)


def test_runs_are_at_most_8_m(suburb: Scene) -> None:
    runs = suburb.table[suburb.table["kind"].isin(["fence", "wall", "hedge"])]
    assert runs[["size_x_m", "size_y_m"]].max(axis=None) <= 8.0


def test_no_two_solid_things_overlap_and_all_stand_on_the_map(suburb: Scene) -> None:
    solids = [o for o in suburb.objects if o.solid]
    footprints = np.array([o.footprint for o in solids], dtype=object)
    first, second = shapely.STRtree(footprints).query(footprints, predicate="dwithin", distance=0.8)
    close = [(solids[a].name, solids[b].name) for a, b in zip(first, second, strict=True) if a < b]
    assert close == []  # not even so near that a robot could not pass between
    on_map = shapely.box(-65, -90, 65, 90)
    assert [o.name for o in solids if not on_map.contains(o.footprint)] == []


def test_nothing_floats_or_is_sunk(suburb: Scene) -> None:
    lowest = {o.name: o.bounds_m[0, 2] for o in suburb.objects if o.solid}
    assert {name: z for name, z in lowest.items() if abs(z) > 0.02} == {}


def test_flat_ground_is_flat_and_covers_the_map_once(suburb: Scene) -> None:
    area = 0.0
    for thing in suburb.objects:
        if thing.kind in GROUND - {"backdrop"}:
            corners = triangles(thing)
            assert np.abs(corners[:, :, 2]).max() == 0.0
            a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
            doubled = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
            assert doubled.min() > -1e-4, "the ground has to be seen from above"
            area += doubled.sum() / 2
    assert area == pytest.approx(330.0 * 380.0, rel=1e-6)


def test_the_first_surface_that_a_look_meets_faces_it(suburb: Scene) -> None:
    """Rays from all around: what they hit first must not be the back of a face."""
    import open3d as o3d

    kinds = ("house", "shop", "barn", "vehicle")
    for kind in (*kinds, "fence", "wall", "hedge", "lamp", "mailbox", "bin", "pole"):
        for thing in [o for o in suburb.objects if o.kind == kind][:6]:
            solid = [s for s in thing.surfaces if not s.cut_out]  # leaves have two sides
            corners = triangles(replace(thing, surfaces=tuple(solid))).astype(np.float32)
            caster = o3d.t.geometry.RaycastingScene()
            faces = np.arange(len(corners) * 3, dtype=np.uint32).reshape(-1, 3)
            caster.add_triangles(o3d.core.Tensor(corners.reshape(-1, 3)), o3d.core.Tensor(faces))
            low, high = thing.bounds_m
            middle, reach = (low + high) / 2, float(np.linalg.norm(high - low))
            rng = np.random.default_rng(0)
            aim = rng.uniform(low, high, (4000, 3))
            away = rng.normal(size=(4000, 3))
            away[:, 2] = np.abs(away[:, 2]) * 0.3  # from the side or from above, as a robot looks
            away /= np.linalg.norm(away, axis=1, keepdims=True)
            start = middle + 2 * reach * away
            rays = np.concatenate([start, aim - start], axis=1).astype(np.float32)
            hit = caster.cast_rays(o3d.core.Tensor(rays))
            seen = np.isfinite(hit["t_hit"].numpy())
            towards = np.einsum("ij,ij->i", hit["primitive_normals"].numpy(), rays[:, 3:]) < 0
            assert towards[seen].mean() > 0.995, thing.name
            assert seen.sum() > 50


def test_doors_are_at_the_foot_of_facades(suburb: Scene) -> None:
    """On every upright face of a building, v rises with z, and u to the right as one looks at it:
    pictures are the right way up and not mirrored, and lettering can be read."""
    for thing in [o for o in suburb.objects if o.kind in ("house", "shop", "barn")]:
        for s in thing.surfaces:
            points, uv = s.vertices_m[s.faces].astype(float), s.uv[s.faces].astype(float)
            normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
            upright = np.abs(normal[:, 2]) < 0.05 * np.linalg.norm(normal, axis=1)
            z = points[upright, :, 2] - points[upright, :, 2].mean(axis=1, keepdims=True)
            v = uv[upright, :, 1] - uv[upright, :, 1].mean(axis=1, keepdims=True)
            facade = np.linalg.norm(normal, axis=1)[upright] > 0.8  # not a roof's edge board
            assert facade.sum() >= 8
            assert ((z * v).sum(axis=1)[facade] > 0).all(), thing.name
            right = np.stack([-normal[upright, 1], normal[upright, 0]], axis=1)
            along = np.einsum("ijk,ik->ij", points[upright, :, :2], right)
            along -= along.mean(axis=1, keepdims=True)
            u = uv[upright, :, 0] - uv[upright, :, 0].mean(axis=1, keepdims=True)
            assert ((along * u).sum(axis=1)[facade] > 0).all(), thing.name


def test_arrays_are_what_a_renderer_takes(suburb: Scene) -> None:
    assert suburb.sky is not None
    surfaces = [s for o in suburb.objects for s in o.surfaces] + [suburb.sky]
    for s in surfaces:
        n = len(s.vertices_m)
        assert (s.vertices_m.dtype, s.uv.dtype, s.shade.dtype) == (np.float32,) * 3
        assert (s.faces.dtype, s.texture.dtype) == (np.int32, np.uint8)
        assert s.uv.shape == (n, 2)
        assert s.shade.shape in ((n,), (n, 3))
        assert s.faces.min() >= 0
        assert s.faces.max() < n
        assert np.isfinite(s.vertices_m).all()
        assert np.isfinite(s.uv).all()
        assert s.shade.min() > 0.1  # no side is black
        assert s.shade.max() <= 1
    assert sum(len(s.faces) for s in surfaces) < 140_000
    assert sum(s.texture.nbytes for s in surfaces) < 70e6


def test_the_sky_is_seen_from_inside(suburb: Scene) -> None:
    assert suburb.sky is not None
    corners = suburb.sky.vertices_m[suburb.sky.faces].astype(float)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    proper = np.linalg.norm(normal, axis=1) > 1e-3
    inward = -np.einsum("ij,ij->i", normal, corners.mean(axis=1))
    assert (inward[proper] > 0).all()


def reachable(scene: Scene, step_m: float = 0.5) -> tuple[float, NDArray[np.bool_]]:
    """Share of free space in its largest connected part, and that part as (x, y) grid."""
    half_x, half_y = (e / 2 for e in scene.extent_m)
    x, y = np.arange(-half_x + 0.5, half_x, step_m), np.arange(-half_y + 0.5, half_y, step_m)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    free = scene.is_free(points.reshape(-1, 2)).reshape(points.shape[:2])
    parts, _ = ndimage.label(free)
    sizes = np.bincount(parts.ravel())[1:]
    return float(sizes.max() / free.sum()), parts == 1 + int(sizes.argmax())


def test_a_robot_gets_everywhere(suburb: Scene) -> None:
    share, main = reachable(suburb)
    assert share > 0.995
    assert main.mean() > 0.7  # most of the map is free to drive
    for edge in (main[0], main[-1], main[:, 0], main[:, -1]):
        assert edge.any()
    suburb.check_pose(Pose(10.0, 0.0))
    assert suburb.clearance_m([(10.0, 0.0)])[0] > 1.0


def printed_by_a_fresh_process(code: str, **told: str) -> str:
    """What ``code`` prints, which finds this folder's modules, with hashes of another seed.

    told: more of its environment.
    """
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, sys.argv[1]);{code}",
         str(ROOT / "tests" / "world")],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONHASHSEED": "7", "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}", **told},
        check=True,
    )  # fmt: skip
    return done.stdout


def test_one_seed_gives_the_same_bytes_in_a_fresh_process(suburb: Scene) -> None:
    code = (
        "from test_suburb import SUBURB, digest; from vrchain.world import load_scene;"
        "print(digest(load_scene(SUBURB)))"
    )
    assert printed_by_a_fresh_process(code).strip() == digest(suburb)


def ground_digest() -> str:
    """Of the ground of a suburb whose lawns were cut otherwise by another arctan2."""
    spec = spec_of(load_spec(SUBURB), 10_000, 0)
    ground = build_ground(draw_layout(spec), spec.extent_m, spec.season, generator(0, "ground"))
    corners = b"".join(s.vertices_m.tobytes() for o in ground for s in o.surfaces)
    return hashlib.sha256(corners).hexdigest()


def test_ground_is_cut_alike_by_other_processors() -> None:
    code = "from test_suburb import ground_digest; print(ground_digest())"
    assert printed_by_a_fresh_process(code, **PROCESSORS["AVX2"]).strip() == ground_digest()


SMALL = {
    "extent_m": [70, 90], "houses": {"count": 3}, "shops": {"count": 0}, "barns": {"count": 0},
    "trees": {"count": 8}, "vehicles": {"count": 2},
    "boundaries": {"fences": 2, "walls": 1, "hedges": 2},
    "furniture": {"mailboxes": 2, "lamps": 2, "poles": 1, "signs": 1, "bins": 1, "hydrants": 1,
                  "bushes": 3},
}  # fmt: skip


def small(time: str, season: str) -> Scene:
    return build_scene(parse_spec({**SMALL, "light": {"time": time}, "season": season}))


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


def test_every_light_and_season_is_the_same_in_a_fresh_process() -> None:
    code = (
        "from test_suburb import digest, small;"
        "print(digest(small('evening', 'autumn')), digest(small('overcast', 'winter')))"
    )
    here = digest(small("evening", "autumn")), digest(small("overcast", "winter"))
    assert tuple(printed_by_a_fresh_process(code).split()) == here


def test_another_seed_gives_another_suburb(suburb: Scene) -> None:
    other = load_scene(SUBURB, seed=3000)
    assert digest(other) != digest(suburb)

    def pictures(scene: Scene) -> set[bytes]:
        return {s.texture.tobytes() for o in scene.objects if o.landmark for s in o.surfaces}

    assert pictures(other).isdisjoint(pictures(suburb))
    streets = [draw_layout(replace(load_spec(SUBURB), seed=s)).streets for s in (2000, 3000)]
    assert streets[0].road.symmetric_difference(streets[1].road).area > 500.0
    columns = ["centre_x_m", "centre_y_m"]
    houses = [s.table[s.table["kind"] == "house"][columns].round(2) for s in (suburb, other)]
    assert set(map(tuple, houses[0].to_numpy())).isdisjoint(map(tuple, houses[1].to_numpy()))


def finds_room(seed: int) -> None:
    spec = replace(load_spec(SUBURB), seed=seed)
    layout = draw_layout(spec)
    kinds = Counter(p.kind for p in layout.placements)
    for kind, part in (("house", spec.houses), ("shop", spec.shops), ("barn", spec.barns)):
        assert kinds[kind] == part.count
    assert (kinds["tree"], kinds["vehicle"]) == (spec.trees.count, spec.vehicles.count)
    start = shapely.Point(START_XY_M)
    assert layout.streets.road.contains(start.buffer(1.5))
    standing = [Candidate(p.pose, p.plan.outline).ground for p in layout.placements
                if p.kind in ("house", "shop", "barn")]  # fmt: skip
    assert shapely.union_all(standing).distance(layout.streets.corridor) > 0.3


@pytest.mark.parametrize("seed", [0, 1, 3001, 3002, 10_000])
def test_every_seed_finds_room_for_everything(seed: int) -> None:
    finds_room(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2000, 2030))
def test_thirty_seeds_find_room_for_everything(seed: int) -> None:
    finds_room(seed)


def test_things_at_the_kerb_are_off_the_road() -> None:
    layout = draw_layout(load_spec(SUBURB))
    for p in layout.placements:
        if p.kind in ("lamp", "hydrant", "pole", "sign", "mailbox"):
            assert layout.streets.road.distance(shapely.Point(p.pose.xy_m)) > 0.2, p.name


def test_streets_differ_from_seed_to_seed() -> None:
    """In how many run along x and along y, in junctions and dead ends, not in places alone."""
    patterns = Counter()
    for seed in range(40):
        rng = generator(seed, "streets")
        streets = draw_streets(SceneSpec(), rng)
        headings = [s.at(sum(s.on_map_m) / 2)[1] for s in streets.lines]
        along_x = sum(abs(np.cos(h)) > 0.7 for h in headings)
        patterns[len(headings), along_x, len(streets.junctions), len(streets.heads)] += 1
    assert len(patterns) >= 8
    assert max(patterns.values()) <= 20


def test_a_street_with_a_dead_end_has_a_turning_circle() -> None:
    found = 0
    for seed in range(20):
        streets = draw_streets(SceneSpec(), generator(seed, "streets"))
        for street in streets.lines:
            if street.head is None:
                continue
            found += 1
            last = shapely.Point(street.line.coords[-1])
            assert street.head.equals(last)
            assert streets.road.contains(last.buffer(streets.width_m / 2 + TURNING_M - 0.1))
            assert street.on_map_m[1] < street.line.length - streets.half_m
            assert all(last.distance(p) > 15 for p in streets.junctions)
    assert found >= 4


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
    spec = load_spec(SUBURB)
    none = {
        "houses": replace(spec.houses, count=0),
        "shops": replace(spec.shops, count=0),
        "barns": replace(spec.barns, count=0),
        "trees": replace(spec.trees, count=0),
        "vehicles": replace(spec.vehicles, count=0),
        "boundaries": replace(spec.boundaries, fences=0, walls=0, hedges=0),
        "furniture": replace(
            spec.furniture, mailboxes=0, lamps=0, poles=0, signs=0, bins=0, hydrants=0, bushes=0
        ),
    }
    scene = build_scene(replace(spec, extent_m=(60.0, 60.0), **none))
    assert set(scene.table["kind"]) <= GROUND
