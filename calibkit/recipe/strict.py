"""What every recipe table is made of: a frozen, typed record that is closed to keys it does not
know.
"""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]


class Table(BaseModel):
    """A recipe table: frozen, typed, and closed to keys it does not know."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        allow_inf_nan=False,
        populate_by_name=True,
        defer_build=True,  # tables that a command does not use are never made ready
    )
