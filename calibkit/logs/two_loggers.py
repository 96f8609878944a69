"""Which logs of a folder are a second logger's, and the table [chamber] that joins them."""

import re
from pathlib import PurePosixPath

from calibkit.logs import column_names
from calibkit.logs.evidence import Evidence
from calibkit.recipe.toml_text import write_value

AIR = "temp_env_degc"


def propose_chamber(evidence: Evidence) -> tuple[str, tuple[str, ...]] | None:
    """Table [chamber] of the second logger beside a log that lacks chamber air, and its files;
    None where there is none, or several could be meant.
    """
    if len(evidence.chamber_loggers) != 1 or "time_s" not in evidence.columns:
        return None
    (second,) = evidence.chamber_loggers
    columns, _ = column_names.assign_columns(second.columns)
    air, time = columns.get(AIR) or columns.get("temp_case_degc"), columns.get("time_s")
    files = list(second.files)
    if len(files) > 1:  # a pattern with the name of each log, which one file has
        patterns = set()
        for stem in (PurePosixPath(file).stem for file in evidence.group.files):
            files_of_log = [name for name in second.files if stem in name]
            only = files_of_log[0] if len(files_of_log) == 1 else ""
            patterns.add(only.replace(stem, "{log}", 1))
        files = sorted(patterns)
    if air is None or time is None or len(files) != 1 or not files[0]:
        return None
    layout = second.layout
    lines = ["[chamber]", f"files = {write_value(files)}"]
    if layout.format not in ("csv", "text"):
        lines.append(f'format = "{layout.format}"')
    if layout.names:
        lines.append(f"names = {write_value(layout.names)}")
    lines.append(f'provides = ["{AIR}"]')
    probes = [column for name, column in evidence.alternatives if name in (AIR, "temp_case_degc")]
    of_air = [column for column in probes if re.search(r"air|luft|env|probe|amb", column.plain)]
    if of_air:
        unit = "" if of_air[0].stated else ', unit = "degC"'
        lines += [
            'clock = "estimate" # from the air that both loggers measured',
            f'shared = "{AIR}"',
            f"log_column = {{ from = {write_value(of_air[0].name)}{unit} }}",
        ]
    elif evidence.columns["time_s"].is_time and time.is_time:
        lines += [
            '# where the clocks differ: "stated", with offset_s and standard_uncertainty_s',
            'clock = "same"',
        ]
    else:
        lines += [
            'clock = "stated"',
            "offset_s = 0.0 # from the log's first row to the other file's: state it",
            "standard_uncertainty_s = 10.0",
        ]
    if layout.text:
        pinned = (f"{k} = {write_value(v)}" for k, v in layout.text.items())
        lines += ["", "[chamber.text]", *pinned]
    form = f", time_format = {write_value(time.time_format)}" if "%" in time.time_format else ""
    unit = "" if air.stated else ', unit = "degC"'
    lines += [
        "",
        "[chamber.columns]",
        f"time_s = {{ from = {write_value(time.name)}{form} }}",
        f"{AIR} = {{ from = {write_value(air.name)}{unit} }}",
    ]
    return "\n".join(["", *lines, ""]), second.files
