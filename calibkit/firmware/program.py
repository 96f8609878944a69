"""A chain in one number format: the same steps, with the numbers that the firmware holds."""

from collections.abc import Mapping
from dataclasses import dataclass

from calibkit.firmware.chain import Chain, Structure
from calibkit.firmware.formats import Format


@dataclass(frozen=True, slots=True)
class Program:
    """Steps and numbers of a firmware; everything that decides a result bit for bit."""

    structure: Structure
    format: Format
    tables: Mapping[str, tuple[float, ...]]


def quantise(chain: Chain, number: Format) -> Program:
    """Program of a chain in a number format."""
    tables = {name: tuple(map(number.nearest, numbers)) for name, numbers in chain.tables.items()}
    for entry in chain.structure.inputs:  # the full scale is a fact of the header alone
        tables[entry.table] = tables[entry.table][:2]
    return Program(chain.structure, number, tables)
