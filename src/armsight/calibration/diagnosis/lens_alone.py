"""How sure a lens is that was told by pictures of the board alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armsight.calibration.findings import Finding
from armsight.calibration.lens import LensCalibration

UNSURE = 0.01
"""Sigma of the focal length, as a share of it, that is worth a word [1]."""
UNKNOWN = 0.05
"""The same where the pictures have told next to nothing [1]."""


def lens_findings(names: Sequence[str], lenses: Sequence[LensCalibration]) -> list[Finding]:
    """Lenses whose focal length the frames do not tell.

    Args:
        names: of the cameras.
        lenses: of each.
    """
    out = []
    for name, lens in zip(names, lenses):
        share = float(np.sqrt(max(lens.covariance[0, 0], 0.0))) / lens.camera.fx
        if share > UNSURE:
            out.append(
                Finding(
                    "lens_unsure",
                    "error" if share > UNKNOWN else "warning",
                    f"{name}: {lens.frames} frames tell the focal length to {100 * share:.1f} %",
                    "take ten or more, with the board tilted by 20-40 deg in different directions",
                )
            )
    return out
