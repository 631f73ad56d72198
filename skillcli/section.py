"""What recipe sections are made of: frozen, bounded, described values."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


def value(default: Any, description: str, unit: str = "", **bounds: Any) -> Any:
    """A recipe field: its default, what it means, its unit, and the bounds it must keep."""
    return Field(default=default, description=description, json_schema_extra={"unit": unit}, **bounds)


class Section(BaseModel):
    """Frozen: unknown keys, NaN and infinities are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
