"""Robots from their URDF: kinematics, limits, link shapes, the catalogue."""
