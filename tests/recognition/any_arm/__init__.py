"""Tests of :mod:`armsight.recognition.any_arm`."""
