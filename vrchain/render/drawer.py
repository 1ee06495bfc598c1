"""pyrender's context, buffers and textures, drawn by two small shaders of our own.

Without a GPU this is three times as fast as pyrender's own pass, which samples every pixel four
times, multiplies matrices at every vertex, sets some thirty uniforms a primitive and reads the
depth back. Edges are a little rougher; landmarks are found as well.
"""

import ctypes
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyrender
from numpy.typing import NDArray
from OpenGL import GL
from pyrender.constants import RenderFlags
from pyrender.renderer import Renderer
from pyrender.shader_program import ShaderProgramCache

_SHADERS = Path(__file__).parent / "shaders"
_INDEX_BYTES = 4


@dataclass(frozen=True, eq=False)
class Runs:
    """Which triangles of a primitive to draw: from ``first``, ``count`` of them; (n,) int each."""

    first: NDArray[np.int64]
    count: NDArray[np.int64]


class Drawer(Renderer):
    """pyrender's renderer with a pass for what is lit beforehand and never moves."""

    def __init__(self, width_px: int, height_px: int) -> None:
        super().__init__(width_px, height_px)
        self._own_programs = ShaderProgramCache(shader_dir=str(_SHADERS))

    def draw(
        self,
        scene: pyrender.Scene,
        camera: NDArray[np.float64],
        shown: list[Runs],
        size_px: tuple[int, int],
        what: Literal["colour", "objects"],
    ) -> NDArray[np.uint8]:
        """The scene's one mesh, (height, width, 3); camera: world to clip space, (4, 4)."""
        self.viewport_width, self.viewport_height = size_px
        self._update_context(scene, RenderFlags.FLAT)
        self._configure_forward_pass_viewport(RenderFlags.OFFSCREEN)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._main_fb)
        GL.glDisable(GL.GL_BLEND)
        GL.glDisable(GL.GL_CULL_FACE)
        GL.glClearColor(*(scene.bg_color if what == "colour" else (0.0, 0.0, 0.0, 1.0)))
        GL.glClear(GL.GL_COLOR_BUFFER_BIT | GL.GL_DEPTH_BUFFER_BIT)
        program = self._own_programs.get_program("panorama.vert", f"{what}.frag")
        if not program._in_context():
            program._add_to_context()
        program._bind()
        program.set_uniform("camera", camera)
        GL.glActiveTexture(GL.GL_TEXTURE0)
        for mesh in scene.meshes:
            for primitive, runs in zip(mesh.primitives, shown, strict=True):
                if len(runs.count):
                    primitive.material.baseColorTexture._bind()
                    primitive._bind()
                    _draw(runs)
                    primitive._unbind()
        program._unbind()
        width_px, height_px = size_px
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        pixels: Any = GL.glReadPixels(0, 0, width_px, height_px, GL.GL_RGB, GL.GL_UNSIGNED_BYTE)
        return np.frombuffer(pixels, np.uint8).reshape(height_px, width_px, 3)[::-1]


def _draw(runs: Runs) -> None:
    counts = (3 * runs.count).astype(np.int32)
    offsets = (3 * _INDEX_BYTES * runs.first).astype(np.uintp)
    pointers = offsets.ctypes.data_as(ctypes.POINTER(ctypes.c_void_p))
    GL.glMultiDrawElements(GL.GL_TRIANGLES, counts, GL.GL_UNSIGNED_INT, pointers, len(counts))
