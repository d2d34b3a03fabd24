"""Compiled inner loops of mapping: images, the arm's body, distance fields, reachability.

Each has a plain-numpy twin in ``tests/mapping/twins.py``.
"""
