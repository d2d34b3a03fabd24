"""Pictures of made-up views of ports, by the renderer of the experiments."""

from __future__ import annotations

from pathlib import Path

from armsight.devices.camera_models import stereo_pair
from armsight.experiments.port_pictures import Album
from armsight.experiments.port_scene import PortPicture, PortView


def taken(view: PortView, folder: Path) -> PortPicture:
    """What the converging pair sees of a view; wants OpenGL."""
    album = Album(stereo_pair(), samples=0, folder=folder)
    picture = album.picture(view)
    album.close()
    return picture
