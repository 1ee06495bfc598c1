"""Many textures packed into one, so that a scene is drawn in a few calls instead of hundreds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vrchain.world.model import Surface

_GUTTER_PX = 8  # the edge texels go on this far, or coarse mipmaps would mix neighbours
_WIDTH_PX = 8192
_MOST_PX = 16384  # high: more is no texture to most drivers
_EPSILON = 1e-3


@dataclass(frozen=True, eq=False)
class Joined(Surface):
    """Many surfaces in one. shade: (n, 3); owner: (n,) int32, which of them a vertex is of."""

    owner: NDArray[np.int32]


def join(surfaces: Sequence[Surface]) -> Joined:
    """Surfaces as one, of the texture of the first."""
    counts = [len(s.vertices_m) for s in surfaces]
    faces = [s.faces + n for s, n in zip(surfaces, np.cumsum([0, *counts])[:-1], strict=True)]
    none = np.empty((0, 3), dtype=np.float32)
    return Joined(
        np.concatenate([none, *(s.vertices_m for s in surfaces)]),
        np.concatenate([np.empty((0, 3), dtype=np.int32), *faces]).astype(np.int32),
        np.concatenate([none[:, :2], *(s.uv for s in surfaces)]),
        np.concatenate([none, *(s.shade_rgb for s in surfaces)]),
        surfaces[0].texture if surfaces else np.zeros((1, 1, 3), dtype=np.uint8),
        np.repeat(np.arange(len(surfaces), dtype=np.int32), counts),
    )


def join_by_texture(surfaces: Sequence[Surface]) -> list[Joined]:
    """Surfaces that share a texture array become one, in order of first use."""
    groups: dict[int, list[int]] = {}
    for index, surface in enumerate(surfaces):
        groups.setdefault(id(surface.texture), []).append(index)
    joined = [(join([surfaces[i] for i in group]), group) for group in groups.values()]
    return [replace(j, owner=np.array(group, dtype=np.int32)[j.owner]) for j, group in joined]


def pack(surfaces: Sequence[Surface]) -> list[Joined]:
    """The same picture with fewer textures: those that never repeat share an atlas.

    Textures that repeat (uv beyond 0..1) stay by themselves, first and in their order. Cut-outs
    come last, in an atlas of their own: what is opaque is drawn faster.
    """
    joined = join_by_texture(surfaces)
    return [
        *_pack_alike([s for s in joined if not s.cut_out]),
        *_pack_alike([s for s in joined if s.cut_out]),
    ]


def _pack_alike(joined: list[Joined]) -> list[Joined]:
    """``pack`` for textures of as many channels."""
    repeating = [s for s in joined if _repeats(s)]
    single = [s for s in joined if not _repeats(s)]
    if len(single) < 2:
        return joined
    single.sort(key=lambda s: -s.texture.shape[0])  # shelves waste least from tall to short
    corners, height_px = _shelves([s.texture.shape[:2] for s in single])
    single, rest = single[: len(corners)], single[len(corners) :]
    atlas = np.zeros((height_px, _WIDTH_PX, single[0].texture.shape[2]), dtype=np.uint8)
    moved = []
    for surface, (row, column) in zip(single, corners, strict=True):
        h, w = surface.texture.shape[:2]
        g = _GUTTER_PX
        atlas[row - g : row + h + g, column - g : column + w + g] = np.pad(
            surface.texture, ((g, g), (g, g), (0, 0)), mode="edge"
        )
        u = (column + np.clip(surface.uv[:, 0], 0, 1) * w) / _WIDTH_PX
        v = 1 - (row + (1 - np.clip(surface.uv[:, 1], 0, 1)) * h) / height_px
        uv = np.stack([u, v], axis=1).astype(np.float32)
        moved.append(replace(surface, uv=uv, texture=atlas))
    packed = replace(join(moved), owner=np.concatenate([s.owner for s in moved]))
    return [*repeating, packed, *(_pack_alike(rest) if rest else [])]


def sort_by_place(surface: Joined, cell_m: float = 16.0) -> tuple[Joined, NDArray[np.int64]]:
    """A surface with the triangles of each square of the map one after the other.

    Returns it and the first triangle of every square, (n_squares + 1,) int: what is out of view can
    be left out, square by square.
    """
    middle = surface.vertices_m[surface.faces][:, :, :2].mean(axis=1)
    _, square = np.unique(np.floor(middle / cell_m), axis=0, return_inverse=True)
    order = np.argsort(square, kind="stable")
    starts = np.searchsorted(square[order], np.arange(square.max() + 2))
    return replace(surface, faces=surface.faces[order]), starts


def _repeats(surface: Surface) -> bool:
    low, high = surface.uv.min(), surface.uv.max()
    return bool(low < -_EPSILON or high > 1 + _EPSILON or surface.texture.shape[1] > _WIDTH_PX // 2)


def _shelves(shapes: Sequence[tuple[int, int]]) -> tuple[list[tuple[int, int]], int]:
    """Top left corner (row, column) of each picture, set in rows; and the height of it all.

    Of as many as have room; of one at least.
    """
    corners: list[tuple[int, int]] = []
    row = column = shelf = 0
    for h, w in shapes:
        if column + w + 2 * _GUTTER_PX > _WIDTH_PX:
            row, column, shelf = row + shelf, 0, 0
        if corners and row + h + 2 * _GUTTER_PX > _MOST_PX:
            break
        corners.append((row + _GUTTER_PX, column + _GUTTER_PX))
        column += w + 2 * _GUTTER_PX
        shelf = max(shelf, h + 2 * _GUTTER_PX)
    return corners, row + shelf
