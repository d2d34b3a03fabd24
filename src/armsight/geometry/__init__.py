"""Poses, cameras, point clouds and registration: mathematics without devices."""
