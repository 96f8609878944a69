"""Which logs of a folder are a second logger's, and the table [chamber] that joins them."""

import re
from pathlib import PurePosixPath

from calibkit.logs import column_names
from calibkit.logs.column_names import LogColumn
from calibkit.logs.evidence import Evidence
from calibkit.logs.log_groups import Group
from calibkit.recipe.toml_text import write_value

AIR = "temp_env_degc"


def propose_chamber(evidence: Evidence) -> tuple[str, tuple[str, ...]] | None:
    """Table [chamber] of the second logger beside a log that lacks chamber air, and its files;
    None where there is none, or several could be meant.
    """
    if len(evidence.chamber_loggers) != 1 or "time_s" not in evidence.columns:
        return None
    (second,) = evidence.chamber_loggers
    files = _name_files(evidence.group, second)
    columns, _ = column_names.assign_columns(second.columns)
    air = columns.get(AIR) or columns.get("temp_case_degc")
    if air is None or "time_s" not in columns or not files:
        return None
    layout = second.layout
    lines = ["[chamber]", f"files = {write_value(files)}"]
    if layout.format not in ("csv", "text"):
        lines.append(f'format = "{layout.format}"')
    if layout.names:
        lines.append(f"names = {write_value(layout.names)}")
    lines += [f'provides = ["{AIR}"]', *_relate_clocks(evidence, columns["time_s"])]
    if layout.text:
        pinned = (f"{k} = {write_value(v)}" for k, v in layout.text.items())
        lines += ["", "[chamber.text]", *pinned]
    lines += ["", "[chamber.columns]"]
    for name, column in (("time_s", columns["time_s"]), (AIR, air)):
        key_text = f", time_format = {write_value(column.time_format)}" if column.is_time else ""
        if name == AIR and not column.stated:
            key_text = ', unit = "degC"'
        key_text = key_text if "%" in key_text or name == AIR else ""
        source = write_value(column.name)
        lines.append(f"{name} = {{ from = {source}{key_text} }}")
    return "\n".join(["", *lines, ""]), second.files


def _name_files(group: Group, second: Group) -> list[str]:
    """[chamber] files: one file for all logs, or a pattern with the name of each log; empty where
    neither holds.
    """
    if len(second.files) == 1:
        return list(second.files)
    patterns = set()
    for file in group.files:
        stem = PurePosixPath(file).stem
        files_of_log = [name for name in second.files if stem in name]
        if len(files_of_log) != 1:
            return []
        patterns.add(files_of_log[0].replace(stem, "{log}", 1))
    return sorted(patterns) if len(patterns) == 1 else []


def _relate_clocks(evidence: Evidence, other: LogColumn) -> list[str]:
    """How the clocks are related: by a quantity that both loggers measured, by their stamps, or to
    be stated.
    """
    probes = [column for name, column in evidence.alternatives if name in (AIR, "temp_case_degc")]
    air = [column for column in probes if re.search(r"air|luft|env|probe|amb", column.plain)]
    if air:
        source = write_value(air[0].name)
        unit = "" if air[0].stated else ', unit = "degC"'
        return [
            'clock = "estimate" # from the air that both loggers measured',
            f'shared = "{AIR}"',
            f"log_column = {{ from = {source}{unit} }}",
        ]
    if evidence.columns["time_s"].is_time and other.is_time:
        return [
            '# where the clocks differ: "stated", with offset_s and standard_uncertainty_s',
            'clock = "same"',
        ]
    return [
        'clock = "stated"',
        "offset_s = 0.0 # from the log's first row to the other file's: state it",
        "standard_uncertainty_s = 10.0",
    ]
