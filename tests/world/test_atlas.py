from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
import worlds
from numpy.typing import NDArray

from vrchain.geometry import Pose
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world import atlas
from vrchain.world.atlas import Joined, join_by_texture, pack, sort_by_place
from vrchain.world.model import Scene, Surface, place
from vrchain.world.render import Renderer

RIG = CameraRig(n_views=4, width_px=200, height_px=150, field_of_view_deg=90.0)


def texture(name: str, height_px: int = 16, width_px: int = 16) -> NDArray[np.uint8]:
    return generator(0, "atlas", name).integers(0, 256, (height_px, width_px, 3), dtype=np.uint8)


def square(picture: NDArray[np.uint8], x_m: float = 0.0, times: float = 1.0) -> Surface:
    """A square metre at x, showing its texture, or so many repeats of it each way."""
    surface = worlds.quad([(x_m, 0, 0), (x_m, 1, 0), (x_m, 1, 1), (x_m, 0, 1)], picture)
    return replace(surface, uv=surface.uv * np.float32(times))


def sampled(surface: Surface, u: float, v: float, corner: int) -> NDArray[np.float64]:
    """Texel coordinates (x, y from the top) of (u, v) of the quad whose first vertex is corner."""
    uv = surface.uv[corner : corner + 4].astype(float)
    at = uv[0] + u * (uv[1] - uv[0]) + v * (uv[3] - uv[0])
    h, w = surface.texture.shape[:2]
    return np.array([at[0] * w, (1 - at[1]) * h])


def texel(surface: Surface, u: float, v: float, corner: int = 0) -> NDArray[np.uint8]:
    x, y = sampled(surface, u, v, corner)
    return surface.texture[int(y), int(x)]


def first_vertices(packed: list[Joined], wanted: Surface) -> tuple[Joined, int]:
    """The packed surface that holds a quad, and the number of its first vertex there."""
    for surface in packed:
        for corner in range(0, len(surface.vertices_m), 4):
            if np.array_equal(surface.vertices_m[corner : corner + 4], wanted.vertices_m):
                return surface, corner
    raise AssertionError("a surface was lost")


MIXED = [(16, 16), (64, 8), (1, 1), (3, 500), (200, 200), (8, 8), (5, 7)]


def test_every_texel_is_found_again_and_corners_are_mapped_exactly() -> None:
    surfaces = [square(texture(f"{s}", *s), x_m=k) for k, s in enumerate(MIXED)]
    packed = pack(surfaces)
    assert len(packed) == 1
    for original in surfaces:
        inside, corner = first_vertices(packed, original)
        h, w = original.texture.shape[:2]
        for row in range(0, h, max(1, h // 7)):
            for column in range(0, w, max(1, w // 7)):
                u, v = (column + 0.5) / w, 1 - (row + 0.5) / h
                assert np.array_equal(texel(inside, u, v, corner), original.texture[row, column])
        low = sampled(inside, 0, 0, corner)  # the lower left corner, so the bottom row's edge
        assert np.allclose(low, np.round(low), atol=0.01)
        assert np.allclose(sampled(inside, 1, 1, corner) - low, (w, -h), atol=0.01)


def assert_padded(packed: list[Joined], original: Surface) -> Joined:
    """Around a picture its own edge goes on, as far as coarse mipmaps look. Returns its atlas."""
    inside, corner = first_vertices(packed, original)
    h, w = original.texture.shape[:2]
    column, bottom = np.round(sampled(inside, 0, 0, corner)).astype(int)
    g = atlas._GUTTER_PX
    around = inside.texture[bottom - h - g : bottom + g, column - g : column + w + g]
    assert np.array_equal(around, np.pad(original.texture, ((g, g), (g, g), (0, 0)), "edge"))
    return inside


def test_neighbours_in_the_atlas_keep_away_from_each_other() -> None:
    surfaces = [square(texture(f"{k}", 20, 30), x_m=k) for k in range(6)]
    packed = pack(surfaces)
    assert len(packed) == 1
    for original in surfaces:
        assert_padded(packed, original)


def test_repeating_textures_stay_by_themselves() -> None:
    repeats, beyond = square(texture("r"), 0, times=3.0), square(texture("b"), 9)
    beyond = replace(beyond, uv=beyond.uv - np.float32(0.5))
    singles = [square(texture(f"{k}"), x_m=20 + k) for k in range(3)]
    packed = pack([singles[0], repeats, singles[1], beyond, singles[2]])
    assert len(packed) == 3
    for kept, original in zip(packed, (repeats, beyond), strict=False):
        assert kept.texture is original.texture and np.array_equal(kept.uv, original.uv)
    assert packed[2].texture is not singles[0].texture
    assert len(packed[2].vertices_m) == 12


def cut_out(name: str, height_px: int = 16, width_px: int = 16) -> NDArray[np.uint8]:
    return generator(0, "cut-out", name).integers(0, 256, (height_px, width_px, 4), dtype=np.uint8)


def test_cut_outs_have_an_atlas_of_their_own_that_keeps_their_alpha() -> None:
    solid = [square(texture(f"{k}"), k) for k in range(3)]
    leaves = [square(cut_out(f"{k}", 9, 13), 10 + k) for k in range(3)]
    repeats = square(cut_out("r"), 20, times=2.0)
    packed = pack([leaves[0], solid[0], repeats, leaves[1], solid[1], solid[2], leaves[2]])
    assert [s.cut_out for s in packed] == [False, True, True]
    assert packed[1].texture is repeats.texture
    for original in leaves:
        assert assert_padded(packed, original) is packed[2]
    assert packed[2].owner.tolist() == np.repeat([0, 3, 6], 4).tolist()


def test_a_texture_that_repeats_anywhere_repeats_everywhere() -> None:
    shared = texture("shared")
    others = [square(texture(name), x) for x, name in ((2, "a"), (3, "c"))]
    packed = pack([square(shared), square(shared, 1, times=2.0), *others])
    assert len(packed) == 2
    assert packed[0].texture is shared and len(packed[0].vertices_m) == 8


def test_a_hair_beyond_the_edge_is_no_repeat() -> None:
    nearly = square(texture("hair"), times=1.0005)
    packed = pack([nearly, square(texture("other"), 1)])
    assert len(packed) == 1
    inside, corner = first_vertices(packed, nearly)
    size = sampled(inside, 1, 1, corner) - sampled(inside, 0, 0, corner)
    assert np.allclose(size, (16, -16), atol=0.01)


def test_very_wide_textures_stay_by_themselves() -> None:
    wide = square(texture("wide", 2, 5000))
    packed = pack([wide, *(square(texture(f"{k}"), 1 + k) for k in range(3))])
    assert len(packed) == 2 and packed[0].texture is wide.texture


def test_more_than_fits_on_one_shelf() -> None:
    surfaces = [square(texture(f"{k}", 10 + k, 900), x_m=k) for k in range(25)]
    (packed,) = pack(surfaces)
    assert packed.texture.shape[0] > 2 * (35 + 16)
    for original in surfaces:
        inside, corner = first_vertices([packed], original)
        h = original.texture.shape[0]
        for u, v in ((0.0006, 0.01), (0.9994, 0.99), (0.5003, 0.503)):
            expected = original.texture[int((1 - v) * h), int(u * 900)]
            assert np.array_equal(texel(inside, u, v, corner), expected)


def test_more_than_a_driver_takes_is_another_atlas(monkeypatch: pytest.MonkeyPatch) -> None:
    """As it was met: four pictures of 4096 px a side were a texture that no driver took."""
    monkeypatch.setattr(atlas, "_MOST_PX", 100)
    surfaces = [square(texture(f"{k}", 10 + k, 900), x_m=k) for k in range(25)]
    packed = pack(surfaces)
    assert len(packed) == 2 and all(p.texture.shape[0] <= 100 for p in packed)
    assert sum(len(p.faces) for p in packed) == sum(len(s.faces) for s in surfaces)
    one = pack([square(texture("a", 200, 900)), square(texture("b", 200, 900), x_m=1)])
    assert [p.texture.shape[0] for p in one] == [216, 200]  # one at least


@pytest.mark.parametrize("n", [0, 1])
def test_there_is_nothing_to_pack(n: int) -> None:
    surfaces = [square(texture("only"))] * n
    packed = pack(surfaces)
    assert len(packed) == n
    assert all(p.texture is s.texture for p, s in zip(packed, surfaces, strict=True))


def test_surfaces_that_share_a_texture_become_one_in_order_of_first_use() -> None:
    a, b = texture("a"), texture("b")
    joined = join_by_texture([square(a, 0), square(b, 1), square(a, 2), square(b.copy(), 3)])
    assert [len(s.vertices_m) for s in joined] == [8, 4, 4]
    assert joined[0].texture is a and joined[1].texture is b
    assert joined[0].vertices_m[:, 0].tolist() == [0] * 4 + [2] * 4
    assert joined[0].faces.tolist() == [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    assert joined[0].faces.dtype == np.int32 and join_by_texture([]) == []


def test_nothing_that_was_given_is_changed() -> None:
    surfaces = [square(texture(f"{k}"), k) for k in range(3)]
    before = [(s.uv.copy(), s.texture.copy(), s.faces.copy()) for s in surfaces]
    pack(surfaces)
    for s, (uv, picture, faces) in zip(surfaces, before, strict=True):
        assert np.array_equal(s.uv, uv) and np.array_equal(s.texture, picture)
        assert np.array_equal(s.faces, faces)


def triangles(group: Sequence[Surface], with_uv: bool = False) -> NDArray[np.float32]:
    """All triangles, sorted: each corner's place, light and perhaps uv."""
    corners = [
        np.dstack(
            [s.vertices_m[s.faces], s.shade_rgb[s.faces], *([s.uv[s.faces]] if with_uv else [])]
        )
        for s in group
    ]
    flat = np.concatenate([c.reshape(len(c), -1) for c in corners])
    return flat[np.lexsort(flat.T)]


def test_every_triangle_is_still_there_with_its_light() -> None:
    surfaces = [s for o in worlds.yard().objects for s in o.surfaces]
    packed = pack(surfaces)
    assert np.array_equal(triangles(packed), triangles(surfaces))
    assert all(s.uv.dtype == np.float32 and s.faces.dtype == np.int32 for s in packed)


def test_a_surface_sorted_by_place_is_the_same_surface() -> None:
    surfaces = [s for o in worlds.yard().objects for s in o.surfaces]
    whole = pack(surfaces)[0]
    ordered, starts = sort_by_place(whole, 8.0)
    assert np.array_equal(triangles([ordered], True), triangles([whole], True))
    assert starts[0] == 0 and starts[-1] == len(whole.faces) and (np.diff(starts) > 0).all()
    squares = []
    for first, last in pairwise(starts):
        middle = ordered.vertices_m[ordered.faces[first:last]][:, :, :2].mean(axis=1)
        squares.append(np.unique(np.floor(middle / 8.0), axis=0))
    assert all(len(square) == 1 for square in squares)
    assert len(np.unique(np.concatenate(squares), axis=0)) == len(squares) > 5


def test_every_vertex_knows_the_surface_it_comes_from() -> None:
    surfaces = [s for o in worlds.yard().objects for s in o.surfaces]
    for joined in pack(surfaces):
        for index in np.unique(joined.owner):
            of_it = joined.vertices_m[joined.owner == index]
            assert np.array_equal(of_it, surfaces[index].vertices_m)


def gallery() -> Scene:
    """Walls with smooth pictures, of many sizes, some repeating."""
    things = [worlds.ground((40, 40))]
    for k, (h, w) in enumerate([(64, 64), (32, 128), (100, 60), (64, 64), (16, 200), (48, 48)]):
        angle = 2 * np.pi * k / 6
        y, x = np.mgrid[0:h, 0:w]
        picture = np.stack([255 * x / w, 255 * y / h, np.full((h, w), 40 * k)], axis=2)
        wall = worlds.quad([(0, 2, 0), (0, -2, 0), (0, -2, 3), (0, 2, 3)], picture.astype(np.uint8))
        if k >= 4:
            wall = replace(wall, uv=wall.uv * 3)
        pose = Pose(float(5 * np.cos(angle)), float(5 * np.sin(angle)), angle)
        things.append(place(f"wall {k}", "wall", f"wall {k}", [wall], pose, landmark=True))
    return Scene("gallery", (40.0, 40.0), tuple(things))


def test_packed_and_unpacked_are_the_same_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = gallery()
    packed = Renderer(scene)
    monkeypatch.setattr("vrchain.world.render.pack", join_by_texture)
    plain = Renderer(scene)
    assert len(packed._standing) < len(plain._standing) == 7
    for pose in (Pose(0, 0, 0.3), Pose(2, 1, 2.0)):
        a, b = (r.render(pose, RIG).views.astype(int) for r in (packed, plain))
        off = np.abs(a - b).max(axis=-1)
        # alone, a texture's edge is mixed with its opposite edge; in the atlas it is not
        rims = (off > 1).astype(np.uint8)
        assert 0 < rims.mean() < 0.03
        assert not any(cv2.erode(view, np.ones((9, 9), np.uint8)).any() for view in rims)
