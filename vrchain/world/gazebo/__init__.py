"""Gazebo worlds as they are: SDF files, the models that they include, their meshes and materials.

A world and its models are somebody else's files: sizes are bounded, documents hold no entities, and
no path leads out of the model folders.
"""

from vrchain.world.gazebo.world import SUFFIXES, load_world

__all__ = ["SUFFIXES", "load_world"]
