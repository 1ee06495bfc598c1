"""Mesh files as triangles, each kind by its own module."""
