"""A contact permit as the text values of a diagnostic, exact enough to be read back."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from armsight.motion.permits import Permit, PermitState
from armsight.motion.regions import Region

NUMBERS = ("speed", "force", "torque", "until", "pressed")


def permit_to_values(permit: Permit | None) -> dict[str, str]:
    """The values of a permit; none for no permit."""
    if permit is None:
        return {}
    values = {
        "permit/name": permit.name,
        "permit/kind": permit.kind,
        "permit/state": permit.state.value,
        "permit/reason": permit.reason,
        **{f"permit/{name}": repr(float(getattr(permit, name))) for name in NUMBERS},
    }
    region = permit.region
    if region is not None:
        values |= {
            "permit/region": region.shape,
            "permit/region/size": _text(region.size),
            "permit/region/T_base_region": _text(region.T_base_region),
            "permit/region/exposure": repr(float(region.exposure)),
            "permit/region/velocity": _text(region.velocity),
            "permit/region/covariance": _text(region.covariance),
            "permit/region/drift": repr(float(region.drift)),
        }
    return values


def permit_from_values(values: Mapping[str, str]) -> Permit | None:
    """The permit that :func:`permit_to_values` wrote; None if there was none.

    Raises:
        KeyError, ValueError: the values are not ours.
    """
    if "permit/name" not in values:
        return None
    region = None
    if "permit/region" in values:
        size = _numbers(values["permit/region/size"])
        region = Region(
            values["permit/region"],  # type: ignore[arg-type]
            (float(size[0]), float(size[1]), float(size[2])),
            _numbers(values["permit/region/T_base_region"]).reshape(4, 4),
            float(values["permit/region/exposure"]),
            _numbers(values["permit/region/velocity"]).reshape(3),
            _numbers(values["permit/region/covariance"]).reshape(3, 3),
            float(values["permit/region/drift"]),
        )
    return Permit(
        values["permit/name"],
        values["permit/kind"],
        PermitState(values["permit/state"]),
        values["permit/reason"],
        region,
        **{name: float(values[f"permit/{name}"]) for name in NUMBERS},
    )


def _text(numbers: object) -> str:
    return " ".join(repr(float(x)) for x in np.asarray(numbers, float).ravel())


def _numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.split()])
