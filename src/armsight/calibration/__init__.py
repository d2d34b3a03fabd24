"""Lenses, depth, cameras, board and arm from sightings of a board: one solve, honest errors."""
