"""The pose of a camera from what it sees of the arm at work, where the joint angles are known."""

from armsight.recognition.own_arm.answer import ColorView, DepthView, OwnArmPose
from armsight.recognition.own_arm.color import register_color
from armsight.recognition.own_arm.color_scene import ColorOptions
from armsight.recognition.own_arm.color_search import search_color
from armsight.recognition.own_arm.depth import DepthOptions, register_depth
from armsight.recognition.own_arm.depth_search import search_depth
from armsight.recognition.own_arm.surface import ArmSurface, arm_surface

__all__ = [
    "ArmSurface",
    "ColorOptions",
    "ColorView",
    "DepthOptions",
    "DepthView",
    "OwnArmPose",
    "arm_surface",
    "register_color",
    "register_depth",
    "search_color",
    "search_depth",
]
