"""Recordings of ROS 1, ROS 2 and our own (MCAP): pictures and arm poses by their time stamps."""

from __future__ import annotations

BAGS = (".bag", ".mcap", ".db3")
