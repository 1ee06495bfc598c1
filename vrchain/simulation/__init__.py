"""Robots in a scene: their sensors and noise, teams that publish, surveys, and whole missions."""
