"""Steps of a program as lines of JSON, and back: what a file needs beside its numbers to be
evaluated again.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from calibkit.errors import CoefficientError
from calibkit.firmware import chain, formats, steps
from calibkit.firmware.chain import Program
from calibkit.firmware.steps import ChainStep

KINDS: tuple[type[ChainStep], ...] = (
    steps.Map,
    steps.Sum,
    steps.Limit,
    steps.Quotient,
    steps.Memory,
    steps.Play,
    steps.Slope,
    steps.Select,
)
STEPS = {kind.__name__.lower(): kind for kind in KINDS}


def write_program(program: Program) -> list[str]:
    """One line for the whole, one an input, a step, an output."""
    structure = program.structure
    head: dict[str, Any] = {
        "number": program.format.name,
        "forms": structure.forms,
        "formula": structure.formula,
        "interval_s": structure.interval_s,
        # of the fixed point that 0.2 exported: a loader knows its layout by the text of these lines
        "scales": {},
    }
    if structure.pace:
        head["pace"] = asdict(structure.pace)
    return [
        _line({"program": head}),
        *(_line({"input": _input(entry)}) for entry in structure.inputs),
        *(_line({type(step).__name__.lower(): asdict(step)}) for step in structure.steps),
        *(_line({"output": asdict(output)}) for output in structure.outputs),
    ]


def _input(entry: chain.ChainInput) -> dict[str, str]:
    """Fields of an input; `beyond` stands where it is used, so that the layout of a chain that does
    not need it stays as it was.
    """
    entry_fields = asdict(entry)
    if not entry.beyond:
        del entry_fields["beyond"]
    return entry_fields


def _line(document: Mapping[str, Any]) -> str:
    """Compact JSON in ASCII."""
    return json.dumps(document, separators=(",", ":"), sort_keys=True, ensure_ascii=True)


def read_program(
    texts: Sequence[str], tables: Mapping[str, tuple[float, ...]], name: str
) -> Program:
    """Program of its lines and tables; CoefficientError where they do not make one."""
    try:
        documents = [json.loads(text) for text in texts]
        head = documents[0]["program"]
        inputs, chain_steps, outputs = [], [], []
        for document in documents[1:]:
            ((kind, fields),) = document.items()
            if kind == "input":
                inputs.append(chain.ChainInput(**fields))
            elif kind == "output":
                outputs.append(chain.Output(**fields))
            else:
                chain_steps.append(_step(kind, fields))
        structure = chain.Structure(
            tuple(head["forms"]),
            head["formula"],
            tuple(inputs),
            tuple(chain_steps),
            tuple(outputs),
            head["interval_s"],
            _pace(head.get("pace")),
        )
        number = head["number"]
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise CoefficientError(
            f"{name}: its steps cannot be read: {error}", hint="export it again"
        ) from None
    if number not in formats.FORMATS:
        raise CoefficientError(
            f"{name}: numbers of format {number}, expected {' or '.join(formats.FORMATS)}",
            hint="fixed point is no longer exported: calibkit 0.2 verifies it",
        )
    return Program(structure, formats.FORMATS[number], dict(tables))


def _pace(fields: dict[str, Any] | None) -> chain.Pace | None:
    """How time is kept, of its JSON object."""
    tuples = {name: tuple(fields[name]) for name in ("lags", "flags")} if fields else {}
    return chain.Pace(**{**fields, **tuples}) if fields else None


def _step(kind: str, fields: dict[str, Any]) -> ChainStep:
    """A step of its JSON object."""
    terms = [{**term, "factors": tuple(term["factors"])} for term in fields.get("terms", ())]
    nested = {
        "terms": tuple(steps.ChainTerm(**term) for term in terms),
        "cases": tuple(steps.Case(**case) for case in fields.get("cases", ())),
    }
    return STEPS[kind](**{name: nested.get(name, value) for name, value in fields.items()})
