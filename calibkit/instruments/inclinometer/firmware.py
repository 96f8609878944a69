"""inclinometer_scale.json → chain without memory: s(T) of each gyro."""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibkit.firmware import as_firmware, exact
from calibkit.firmware.chain import Output
from calibkit.firmware.draft import Draft, powers
from calibkit.firmware.sources import Correction, required_record
from calibkit.instruments import Firmware
from calibkit.instruments.inclinometer.forms import TEMPERATURE

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from calibkit.coefficients import Record
    from calibkit.firmware.chain import Chain, Structure
    from calibkit.firmware.program import Program
    from calibkit.ingest.write_back import Applied
    from calibkit.instruments.inclinometer.recipe import InclinometerRecipe

FILE = "inclinometer_scale.json"


def corrections(structure: Structure) -> tuple[Correction, ...]:
    """The scale factor of each gyro multiplies its indication."""
    return tuple(
        Correction(output.name, f"gyro_{output.name.removeprefix('scale_')}_dph", product=True)
        for output in structure.outputs
    )


def apply(spec: InclinometerRecipe, quantised: Program, data: Path) -> Applied:
    """Correct every row of a log as the exported firmware would."""
    return as_firmware.apply(spec, quantised, data, corrections(quantised.structure))


def chain(spec: InclinometerRecipe, records: Mapping[str, Record]) -> Chain:
    """s(T) of each gyro, which multiplies its indication; a station's own s is the matter of its
    solution.
    """
    record = required_record(records, FILE, spec)
    draft = Draft()
    for model in record.models:
        raw, name = powers(model, "s"), f"s_{model.name}"
        valid, over = model.valid.get(TEMPERATURE), ""
        if valid is not None:
            over = "u"
            if not draft.inputs:
                draft.temperature(valid)
            raw = exact.mapped(raw, *exact.span(*valid))
        source = draft.sum(name, draft.polynomial(f"{name}_of_t", raw, over))
        meaning = f"scale factor of the {model.name} gyro, to be multiplied with its indication"
        draft.outputs.append(Output(f"scale_{model.name}", "1", source, meaning))
    return draft.chain(
        [model.form for model in record.models], "corrected = scale * indication, for each gyro"
    )


FIRMWARE = Firmware(files=lambda _: (FILE,), chain=chain, apply=apply, corrections=corrections)
