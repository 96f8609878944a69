"""Statements of conformity as a table: result, limits, value with U and k, decision, and the risk
of the rule.
"""

from typing import Any

from calibkit.certificate import conformity, tables
from calibkit.certificate.conformity import ConformityStatement
from calibkit.certificate.content import Certificate
from calibkit.certificate.names import name_result
from calibkit.certificate.words import Lang, Words, unit_mark, with_unit

LIMITS = Words("limits")
"""Head of the column whose entries state the unit of a row."""
_HEADS = (
    Words("result"),
    Words("specification"),
    tables.VALUE,
    tables.U,
    tables.K,
    LIMITS,
    Words("acceptance limits"),
    Words("rule"),
    Words("decision"),
)


def lay_out_conformity(certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Statements of conformity, with the decision rules that they rest on and their risks."""
    statements = certificate.statements
    if not statements:
        text = Words("No statement of conformity was asked for.")
        return {"text": text.of(lang), "table": None, "rules": []}
    text = Words("Compared without rounding, in the unit of the limits.")
    rows = [_statement(statement, lang) for statement in statements]
    rules = sorted({s.rule for s in statements})
    return {
        "text": text.of(lang),
        "table": tables.text_table(_HEADS, "llrrrllll", rows, lang),
        "rules": [
            f"{(conformity.RULES[rule] + Words('. ') + conformity.RISKS[rule]).of(lang)}"
            for rule in rules
        ],
    }


def _statement(s: ConformityStatement, lang: Lang) -> list[str]:
    """Row of one statement of conformity."""
    limits = (s.lower, s.upper)
    limit_texts = [None if limit is None else tables.format_exact(limit) for limit in limits]
    accepted = [
        tables.format_acceptance(*pair, s.result) for pair in zip(s.acceptance, limits, strict=True)
    ]
    return [
        name_result(s.result).of(lang),
        " ".join(filter(None, (s.name, s.source))),
        *tables.format_stated(s.result),
        with_unit(tables.format_limits(*limit_texts), unit_mark(s.result.unit)),
        tables.format_limits(*accepted),
        conformity.RULE_NAMES[s.rule].of(lang),
        conformity.VERDICTS[s.verdict].of(lang) + (f": {s.reason.of(lang)}" if s.reason.en else ""),
    ]
