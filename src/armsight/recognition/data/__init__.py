"""Labelled pictures of robot arms: generating, reading, checking, drawing them."""

from armsight.recognition.data.labelled_set import LabelledSet
from armsight.recognition.data.sample import NO_ROBOT, ROBOT_TYPES, UNKNOWN_ROBOT, Sample

__all__ = ["NO_ROBOT", "ROBOT_TYPES", "UNKNOWN_ROBOT", "LabelledSet", "Sample"]
