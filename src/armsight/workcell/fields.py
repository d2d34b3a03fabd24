"""Kinds of values in a workcell file. Numbers are never taken from strings, never NaN or infinite.

Rule of the file: metres and plain shares have no suffix; everything else says its unit in the name
(``_deg``, ``_mm``, ``_s``, ``_ms``, ``_hz``).
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Share = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1.0)]
Positive = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0)]
NotNegative = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0)]
Brightness = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=0.0, le=1.0)]
Switch = Annotated[bool, Field(strict=True)]
Text = Annotated[str, Field(strict=True, max_length=2000)]
Name = Annotated[str, Field(strict=True, pattern=r"^[A-Za-z][A-Za-z0-9_.-]{0,63}$")]
Model = Annotated[
    str, Field(strict=True, min_length=1, max_length=1000, pattern=r"^[^\x00-\x1f]+$")
]
DriverName = Annotated[
    str,
    Field(
        strict=True,
        max_length=200,
        pattern=r"^[A-Za-z_][A-Za-z0-9_.-]*(:[A-Za-z_][A-Za-z0-9_.]*)?$",
    ),
]
Triple = tuple[Number, Number, Number]
Extent = tuple[Positive, Positive, Positive]
Quaternion = tuple[Number, Number, Number, Number]
Color = tuple[Brightness, Brightness, Brightness]
Joints = Annotated[tuple[Number, ...], Field(min_length=1, max_length=16)]
Connection = dict[Name, str | int | float | bool]


class Section(BaseModel):
    """A table of the file: frozen, and unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, protected_namespaces=())


def key(default: Any, description: str, unit: str = "", **rules: Any) -> Any:
    """A key with its description and unit; ``...`` as the default means that it must be given."""
    return Field(default, description=description, json_schema_extra={"unit": unit}, **rules)
