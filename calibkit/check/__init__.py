"""What is wrong with a log, found before anything is fitted to it."""

from calibkit.check import magnitude, series, thermometers
from calibkit.check.content import (
    find_constant_columns,
    find_copied_rows,
    find_gaps,
    find_implausible_rates,
    find_implausible_temperatures,
    find_missing_values,
    find_out_of_range,
    find_too_few_rows,
    find_unordered_times,
    find_unusable,
    finding_at_row,
    flag_bridged_gaps,
    in_stages,
)

__all__ = [
    "find_constant_columns",
    "find_copied_rows",
    "find_gaps",
    "find_implausible_rates",
    "find_implausible_temperatures",
    "find_missing_values",
    "find_out_of_range",
    "find_too_few_rows",
    "find_unordered_times",
    "find_unusable",
    "finding_at_row",
    "flag_bridged_gaps",
    "in_stages",
    "magnitude",
    "series",
    "thermometers",
]
