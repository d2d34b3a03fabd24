"""A picture's camera from what its own file says: the focal length that cameras and phones write.

Distances follow the focal length one to one, so this is for pictures whose owner knows no better:
makers round it to whole millimetres, and say nothing of the lens's distortion.
"""

from __future__ import annotations

import math
import struct

from PIL import Image

from armsight.geometry.camera import PinholeCamera

_IFD = 0x8769
_FOCAL, _FOCAL_35, _X_RESOLUTION, _UNIT = 0x920A, 0xA405, 0xA20E, 0xA210
_WIDTH, _HEIGHT = 0xA002, 0xA003
_DIAGONAL_35 = math.hypot(36.0, 24.0)
"""Of the film to which focal lengths "in 35 mm" are equivalent [mm] (CIPA DCG-001)."""
_MILLIMETRES = {2: 25.4, 3: 10.0, 4: 1.0}
"""Of the units in which a sensor's resolution is said."""
_FIELD = (0.2, 20.0)
"""Focal length over image width that a lens can have."""


def exif_camera(picture: Image.Image, width: int, height: int) -> PinholeCamera | None:
    """The camera of a picture by its file, or None where the file does not say, or is not believed.

    Nobody's numbers are trusted: a picture of another shape than the camera says was cut, and a
    focal length that no lens has is left out.

    Args:
        picture: as its file was opened.
        width: of it as it is shown, turned upright [px].
        height: likewise.
    """
    try:
        tags = picture.getexif().get_ifd(_IFD)
        said = _number(tags.get(_WIDTH)), _number(tags.get(_HEIGHT))
        if not _same_shape(said, width, height):
            return None
        f = _focal_px(
            _number(tags.get(_FOCAL_35)),
            _number(tags.get(_FOCAL)),
            _number(tags.get(_X_RESOLUTION)) / _MILLIMETRES.get(int(tags.get(_UNIT, 2)), math.nan),
            said,
            width,
            height,
        )
    except (
        ValueError, TypeError, LookupError, AttributeError, ArithmeticError, SyntaxError, OSError,
        struct.error,
    ):  # fmt: skip
        return None  # damaged, or hostile
    if not _FIELD[0] <= f / width <= _FIELD[1]:  # NaN, too
        return None
    return PinholeCamera(width, height, f, f, 0.5 * (width - 1), 0.5 * (height - 1))


def _focal_px(
    film: float, focal: float, per_mm: float, said: tuple[float, float], width: int, height: int
) -> float:
    """The focal length in pixels of the picture, NaN where it is not said."""
    if film > 0:
        return film / _DIAGONAL_35 * math.hypot(width, height)
    # The resolution is of the picture as the camera stored it; it may have been shrunk since.
    share = math.hypot(width, height) / math.hypot(*said) if min(said) > 0 else 1.0
    return focal * per_mm * share


def _same_shape(said: tuple[float, float], width: int, height: int) -> bool:
    """Whether a picture is all of what the camera took, upright or on its side."""
    if not min(said) > 0:
        return True  # it does not say
    long, short = max(said), min(said)
    return abs(long / short - max(width, height) / min(width, height)) < 0.02


def _number(value: object) -> float:
    """A tag's value, NaN where there is none."""
    if value is None:
        return math.nan
    return float(value)  # type: ignore[arg-type]  # Pillow's rationals, or anything at all
