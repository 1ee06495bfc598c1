"""Scenes: a spec file becomes meshes with names, and nothing here needs OpenGL."""

from vrchain.world.build import build_scene, load_scene
from vrchain.world.model import Scene, SceneObject, Surface
from vrchain.world.spec import SceneSpec, load_spec

__all__ = ["Scene", "SceneObject", "SceneSpec", "Surface", "build_scene", "load_scene", "load_spec"]
