"""Gazebo worlds as they are: SDF files, the models that they include, their meshes and materials.

A world and its models are somebody else's files: documents hold no entities, no path leads out of
the model folders, and sizes are bounded. The limits, ``MOST_...``, stand beside what they are of:
more than any world needs, less than harms.
"""

from vrchain.world.gazebo.world import SUFFIXES, load_world

__all__ = ["SUFFIXES", "load_world"]
