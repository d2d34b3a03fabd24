"""Names of topics and frames, as ROS names them."""

from __future__ import annotations

from armsight.devices.data import RgbdCameraInfo


def depth_frame(camera: str) -> str:
    """Name of the frame of a camera's depth lens."""
    return f"{camera}_depth_optical_frame"


def color_frame(camera: str) -> str:
    """Name of the frame of a camera's colour lens."""
    return f"{camera}_color_optical_frame"


def stereo_frame(camera: str, side: str) -> str:
    """Name of the frame of the ``left`` or ``right`` lens of a stereo pair."""
    return f"{camera}_{side}_optical_frame"


def depth_topic(info: RgbdCameraInfo) -> str:
    """ROS calls an image rectified only when its lens has no distortion left."""
    return f"/{info.name}/depth/{'image_rect_raw' if info.depth.is_ideal else 'image_raw'}"


def color_topic(camera: str) -> str:
    """Topic of a camera's colour pictures."""
    return f"/{camera}/color/image_raw"


def small(topic: str) -> str:
    """Where the same pictures lie compressed, as image_transport has it."""
    return topic + ("/compressedDepth" if "/depth/" in topic else "/compressed")


def stereo_topic(camera: str, side: str) -> str:
    """Topic of the ``left`` or ``right`` pictures of a stereo pair."""
    return f"/{camera}/{side}/image_raw"
