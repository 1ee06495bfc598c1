"""Scenes: a spec file becomes meshes with names, and nothing here needs OpenGL."""

from vrchain.scene.model import Scene, SceneObject, Surface
from vrchain.scene.spec import SceneSpec, load_spec
from vrchain.scene.suburb import build_scene, load_scene

__all__ = ["Scene", "SceneObject", "SceneSpec", "Surface", "build_scene", "load_scene", "load_spec"]
