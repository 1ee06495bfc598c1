"""Faces back to back, of which Gazebo shows the one that looks at the camera.

Here all faces are drawn from both sides, so two in one plane that look away from each other, as the
front and the back of a sign, would show through one another: they are put a little apart.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vrchain.world.gazebo.meshes import Part

_APART_M = 0.0015  # each to its side
# Planes are told apart by numbers rounded to these, odd so that no usual length lies between two.
_NORMAL_STEP, _PLANE_STEP_M = 0.00213, 0.000937


def apart(parts: Sequence[Part]) -> list[Part]:
    """The parts of one model, in metres, with back-to-back faces moved to their sides."""
    counts = [len(part.faces) for part in parts]
    triangles = np.concatenate(
        [np.empty((0, 3, 3)), *(part.vertices_m[part.faces] for part in parts)]
    )
    normal, backed = _backed(triangles)
    starts = np.cumsum([0, *counts])
    return [
        _moved(part, normal[i:j], backed[i:j])
        for part, i, j in zip(parts, starts[:-1], starts[1:], strict=True)
    ]


def _backed(
    triangles: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Unit normals (n, 3) of triangles (n, 3, 3), and which share a plane with opposite ones."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    rounded = np.round(normal / _NORMAL_STEP).astype(np.int64)
    first = np.argmax(rounded != 0, axis=1)
    side = np.sign(np.take_along_axis(rounded, first[:, None], axis=1))
    plane = np.round(side[:, 0] * np.einsum("ij,ij->i", normal, a) / _PLANE_STEP_M)
    key = np.column_stack([side * rounded, np.clip(plane, -1e15, 1e15).astype(np.int64)])
    _, member = np.unique(key, axis=0, return_inverse=True)
    n = member.max(initial=-1) + 1
    ahead, behind = (np.bincount(member.ravel()[side[:, 0] == s], minlength=n) for s in (1, -1))
    return normal, ((ahead > 0) & (behind > 0))[member.ravel()]


def _moved(part: Part, normal: NDArray[np.float64], backed: NDArray[np.bool_]) -> Part:
    """A part whose ``backed`` faces, with corners of their own, are moved along their normals."""
    if not backed.any():
        return part
    moved = part.faces[backed]
    corners = moved.ravel()
    points = part.vertices_m[corners] + _APART_M * np.repeat(normal[backed], 3, axis=0)
    faces = part.faces.copy()
    faces[backed] = len(part.vertices_m) + np.arange(len(corners)).reshape(-1, 3)
    return replace(
        part,
        vertices_m=np.concatenate([part.vertices_m, points]),
        faces=faces,
        uv=None if part.uv is None else np.concatenate([part.uv, part.uv[corners]]),
        shade=None if part.shade is None else np.concatenate([part.shade, part.shade[corners]]),
    )
