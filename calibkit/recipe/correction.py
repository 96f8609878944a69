"""Corrections of reference instruments from their own certificates."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from calibkit.recipe.strict import Table

CORRECTED = ("temp_", "table_", "inclination_", "toolface_", "azimuth_", "position_")
"""Beginnings of the columns that reference instruments write: only they have certificates of their
own.
"""


class Correction(Table):
    """Corrections of a reference instrument from its own certificate: reference = indication +
    correction.

    Between the points of the certificate corrections are interpolated linearly, in the unit of the
    column.
    """

    #: Column of a thermometer, table or attitude reference.
    column: str
    #: Number of its certificate.
    certificate: Annotated[str, Field(min_length=1)]
    #: Name of the instrument.
    instrument: str = ""
    #: Indications of the certificate, ascending, in the column's unit.
    indication: Annotated[tuple[float, ...], Field(min_length=1, strict=False)]
    #: Corrections at these: reference = indication + correction.
    correction: Annotated[tuple[float, ...], Field(min_length=1, strict=False)]
    #: "hold" keeps the correction of the end outside the certificate's points.
    beyond: Literal["refuse", "hold"] = "refuse"

    @model_validator(mode="after")
    def _of_a_reference(self) -> Correction:
        if not self.column.startswith(CORRECTED):
            raise ValueError(
                f"column = '{self.column}' is no reference instrument's: what is calibrated is not"
                " corrected"
            )
        if len(self.indication) != len(self.correction):
            raise ValueError(
                f"{len(self.indication)} indications and {len(self.correction)} corrections"
            )
        if any(b <= a for a, b in zip(self.indication, self.indication[1:], strict=False)):
            raise ValueError("the indications of a certificate must ascend")
        return self
