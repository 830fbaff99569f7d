"""How an effect declares its parameters: unit, prior range, bounds of sense, and the value that means no effect."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import inf, isnan
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, ...] = ("x", "y", "z")


@dataclass(frozen=True)
class Parameter:
    """One declared parameter.

    prior: range in which its size is plausible, in its unit; signed: either sign is. least, most: beyond them a value
    is absurd. default: None where it must be stated. neutral: the value without effect, None for a parameter that only
    shapes it; "twin" where it is whatever the twin says. per_axis: three values, x, y, z.
    """

    name: str
    unit: str
    about: str
    prior: tuple[float, float]
    signed: bool
    least: float
    most: float
    default: Any
    neutral: float | str | None
    per_axis: bool

    @property
    def is_severity(self) -> bool:
        """Whether its size says how strong the effect is."""
        return self.neutral is not None


def parameter(
    unit: str,
    about: str,
    *,
    prior: tuple[float, float],
    most: float,
    least: float | None = None,
    default: Any = ...,
    neutral: float | str | None = None,
) -> Any:
    """A field of an effect; ``least`` defaults to ``-most``, which makes the parameter a signed one."""
    signed = least is None
    extra: dict[str, Any] = {
        "unit": unit,
        "prior": prior,
        "signed": signed,
        "least": -most if least is None else least,
        "most": most,
    }
    return Field(default, description=about, json_schema_extra={**extra, "neutral": neutral})


def declared(name: str, field: FieldInfo) -> Parameter | None:
    """The declaration behind a field; None for an axis."""
    extra = field.json_schema_extra
    if not isinstance(extra, dict) or "unit" not in extra:
        return None
    details: dict[str, Any] = dict(extra)
    default = None if field.default is PydanticUndefined else field.default
    per_axis = "tuple" in str(field.annotation)
    return Parameter(name=name, about=field.description or "", default=default, per_axis=per_axis, **details)


def check(item: Parameter, value: Any) -> None:
    """Raise ValueError for a number that makes no sense."""
    for number in value if isinstance(value, tuple) else (value,):
        if number is not None and (isnan(number) or not item.least <= number <= item.most):
            span = f"at least {item.least:g}" if item.most == inf else f"between {item.least:g} and {item.most:g}"
            raise ValueError(f"must be {span} {item.unit}, not {number:g}".replace("  ", " "))


def _three(value: object, missing: float | None) -> object:
    """A number stands for all axes; a table may leave axes out."""
    if isinstance(value, int | float):
        return (value, value, value)
    if isinstance(value, dict):
        unknown = ", ".join(sorted(set(map(str, value)) - set(AXES)))
        if unknown:
            raise ValueError(f"there is no axis {unknown} (axes are x, y and z)")
        return tuple(value.get(axis, missing) for axis in AXES)
    if isinstance(value, Iterable) and not isinstance(value, str):
        return tuple(value)
    return value


Vector = Annotated[tuple[float, float, float], BeforeValidator(lambda value: _three(value, 0.0))]
Override = Annotated[
    tuple[float | None, float | None, float | None], BeforeValidator(lambda value: _three(value, None))
]

FLEXURE_MOST = 600.0  # arcmin, beyond which no deck bends
