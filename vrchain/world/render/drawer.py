"""pyrender's context, buffers and textures, drawn by a pair of small shaders of our own.

Without a GPU this is three times as fast as pyrender's own pass, which samples every pixel four
times, multiplies matrices at every vertex, sets some thirty uniforms a primitive and reads the
depth back. Edges are a little rougher; landmarks are found as well.
"""

import ctypes
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyrender
from numpy.typing import NDArray
from OpenGL import GL
from pyrender.constants import RenderFlags
from pyrender.renderer import Renderer
from pyrender.shader_program import ShaderProgram, ShaderProgramCache

from vrchain.world.model import LightMap

_SHADERS = Path(__file__).parent / "shaders"
_INDEX_BYTES = 4


class Drawer(Renderer):
    """pyrender's renderer with a pass for what is lit beforehand and never moves."""

    def __init__(self, width_px: int, height_px: int) -> None:
        super().__init__(width_px, height_px)
        self._own_programs = ShaderProgramCache(shader_dir=str(_SHADERS))
        GL.glPixelStorei(GL.GL_UNPACK_ALIGNMENT, 1)  # rows of textures may have any length

    def draw(
        self,
        scene: pyrender.Scene,
        camera: NDArray[np.float64],
        shown: list[tuple[pyrender.Primitive, NDArray[np.int64], NDArray[np.int64]]],
        size_px: tuple[int, int],
        what: Literal["colour", "objects"],
        ground: LightMap | None,
    ) -> NDArray[np.uint8]:
        """What is shown of the scene's primitives, (height, width, 3), drawn in that order.

        camera: world to clip space, (4, 4); shown: primitives, and of each the runs of triangles to
        draw: the first triangles, (n,), and how many, (n,); ground: where the light map lies that
        some primitives have for their occlusion texture.
        """
        self.viewport_width, self.viewport_height = size_px
        self._update_context(scene, RenderFlags.FLAT)
        self._configure_forward_pass_viewport(RenderFlags.OFFSCREEN)
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._main_fb)
        GL.glDisable(GL.GL_BLEND)
        GL.glDisable(GL.GL_CULL_FACE)
        GL.glClearColor(*(scene.bg_color if what == "colour" else (0.0, 0.0, 0.0, 1.0)))
        GL.glClear(GL.GL_COLOR_BUFFER_BIT | GL.GL_DEPTH_BUFFER_BIT)
        GL.glActiveTexture(GL.GL_TEXTURE0)
        for primitive, first, count in shown:
            if len(count):
                texture = primitive.material.baseColorTexture
                light_map = primitive.material.occlusionTexture if what == "colour" else None
                # What is opaque is drawn without discard, so that its depth is tested first.
                program = self._program(
                    OBJECTS=what == "objects",
                    CUT_OUT=texture.source_channels == "RGBA",
                    GROUND=light_map is not None,
                )
                program._bind()
                program.set_uniform("camera", camera)
                if light_map is not None and ground is not None:
                    area_m = np.concatenate([ground.low_m, ground.high_m - ground.low_m])
                    program.set_uniform("map_area", area_m)
                    program.set_uniform("light_map", 1)
                    GL.glActiveTexture(GL.GL_TEXTURE1)
                    light_map._bind()
                    GL.glActiveTexture(GL.GL_TEXTURE0)
                texture._bind()
                primitive._bind()
                _draw(first, count)
                primitive._unbind()
                program._unbind()
        width_px, height_px = size_px
        GL.glPixelStorei(GL.GL_PACK_ALIGNMENT, 1)
        pixels: Any = GL.glReadPixels(0, 0, width_px, height_px, GL.GL_RGB, GL.GL_UNSIGNED_BYTE)
        return np.frombuffer(pixels, np.uint8).reshape(height_px, width_px, 3)[::-1]

    def _program(self, **variants: bool) -> ShaderProgram:
        defines = {name: 1 for name, wanted in variants.items() if wanted}
        program = self._own_programs.get_program("panorama.vert", "panorama.frag", defines=defines)
        if not program._in_context():
            program._add_to_context()
        return program


def _draw(first: NDArray[np.int64], count: NDArray[np.int64]) -> None:
    counts = (3 * count).astype(np.int32)
    offsets = (3 * _INDEX_BYTES * first).astype(np.uintp)
    pointers = offsets.ctypes.data_as(ctypes.POINTER(ctypes.c_void_p))
    GL.glMultiDrawElements(GL.GL_TRIANGLES, counts, GL.GL_UNSIGNED_INT, pointers, len(counts))
