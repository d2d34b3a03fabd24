"""Charging ports and plugs: their models, finding them, their pose, calibration by the plug."""
