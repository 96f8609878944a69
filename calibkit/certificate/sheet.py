"""A certificate in the words of one language or both: the JSON object that the PDF's template
typesets.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from calibkit.certificate import circumstances, conformity, names, plots, tables
from calibkit.certificate.circumstances import Rows, in_words, list_given
from calibkit.certificate.conformity import ConformityStatement
from calibkit.certificate.content import VALIDATION, Certificate
from calibkit.certificate.profile import Laboratory, Party, Profile
from calibkit.certificate.results import Block, ListTable
from calibkit.certificate.run_files import BeforeAfter
from calibkit.certificate.words import AS_FOUND, AS_LEFT, HEADINGS, SENTENCES, Lang, Words
from calibkit.numeric import gum
from calibkit.records.coefficients import Criterion
from calibkit.records.new_files import RUN_FILE
from calibkit.units import unit_mark, with_unit

LIMITS = Words("limits")
"""Head of the column whose entries state the unit of a row."""
CONFORMITY_HEADS = (
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


def sheet(certificate: Certificate, lang: Lang, *, signed: bool = False) -> dict[str, Any]:
    """JSON object of a certificate, which is signed electronically or by hand."""
    profile = certificate.profile
    signatories = circumstances.list_signatories(certificate, lang)
    return {
        "lang": "zh" if lang == "zh" else "en",
        "draft": certificate.draft,
        "signed": signed,
        "title": certificate.title.of(lang),
        "number": profile.certificate.number,
        "laboratory": profile.laboratory.name,
        "words": {
            key: words.of(lang)
            for key, words in (HEADINGS | {f"s_{k}": v for k, v in SENTENCES.items()}).items()
        },
        "missing": [[m.key, m.description.of(lang)] for m in certificate.missing],
        "rejected": certificate.rejection.of(lang),
        "amendment": _amendment(profile, lang),
        "parties": [
            _party(profile.laboratory, lang),
            _party(profile.customer, lang, profile.certificate.order),
        ],
        "item": _item(certificate, lang),
        "method": _method(certificate, lang),
        "conditions": circumstances.lay_out_conditions(certificate, lang),
        "traceability": circumstances.lay_out_traceability(profile, lang),
        "accreditation": Words.literal(" ")
        .join(circumstances.describe_accreditation(certificate))
        .of(lang),
        "reproduction": profile.certificate.reproduction or SENTENCES["reproduction"].of(lang),
        "principal": _principal(certificate, lang),
        "blocks": [_block(block, certificate, lang) for block in certificate.blocks],
        "as_found": _as_found(certificate, lang),
        "conformity": _conformity(certificate, lang),
        "budgets": _budgets(certificate, lang),
        "data": _data(certificate, lang),
        "remarks": [text for text in profile.remarks if text.strip()],
        "signatories": signatories,
        "authorisation": [row for rows in signatories for row in rows],
    }


def _principal(certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Principal results by their names."""
    principal_results = [
        replace(result, name=names.name_result(result), standard="", symbol="")
        for result in certificate.results
        if result.principal and not result.by_definition
    ]
    return tables.lay_out_list(ListTable(Words(""), tuple(principal_results)), lang)


def _party(party: Party, lang: Lang, order: str = "") -> Rows:
    """Name, address and contact details of a laboratory with its code and place of work, or of a
    customer with the number of the order.
    """
    label, place = Words("Customer"), []
    code = list_given((Words("Order"), order))
    if isinstance(party, Laboratory):
        label = Words("Laboratory")
        code = list_given((Words("Laboratory code"), party.code))
        place = [(Words("Place of work"), party.place_of_work)]
    return in_words(
        [
            (label, party.name),
            *code,
            (Words("Address"), party.address),
            *list_given((Words("Country"), party.country)),
            *place,
            *list_given(
                (Words("E-mail"), party.email),
                (Words("Telephone"), party.phone),
            ),
        ],
        lang,
    )


def _item(certificate: Certificate, lang: Lang) -> Rows:
    """What was calibrated, in which condition, when."""
    item, dates = certificate.profile.item, certificate.profile.dates
    numbering = certificate.profile.certificate
    until = f" … {dates.performed_until}" if dates.performed_until else ""
    return in_words(
        [
            (Words("Item"), item.type),
            (Words("Maker"), item.maker),
            (Words("Model"), item.model),
            (Words("Serial number"), certificate.run.serial),
            *list_given((Words("Identification"), item.identification)),
            (Words("Condition"), item.condition),
            *list_given((Words("Certificate before"), numbering.previous)),
            *list_given((Words("Received"), str(dates.received or ""))),
            (Words("Calibrated"), f"{dates.performed or ''}{until}"),
            (Words("Issued"), str(certificate.issued)),
        ],
        lang,
    )


def _method(certificate: Certificate, lang: Lang) -> Rows:
    """Procedure with revision, software, deviations, external providers, excluded data."""
    method, run = certificate.profile.method, certificate.run
    revision, *further = circumstances.list_method(certificate.profile)
    return in_words(
        [
            (Words("Method"), method.name),
            revision,
            (
                Words("Evaluation"),
                f"{run.software}, {run.recipe} ({run.procedure}), {run.name}",
            ),
            *further,
            *(
                (Words("Left out"), f"{item}: {reason} ({person})")
                for item, reason, person in run.excluded
            ),
            *(
                (Words("Left out"), circumstances.describe_left_out(fact).of(lang))
                for fact in run.left_out
            ),
        ],
        lang,
    )


def _block(block: Block, certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Equation, tables, figures and notes of one coefficient file."""
    laid_out_tables: list[dict[str, Any]] = []
    for table in block.tables:
        laid_out_tables += (
            [tables.lay_out_list(table, lang)]
            if isinstance(table, ListTable)
            else tables.lay_out_grid(table, lang)
        )
    return {
        "title": block.title.of(lang),
        "file": block.file,
        "sha256": next((a.sha256 for a in certificate.attachments if a.name == block.file), ""),
        "equations": [{"form": e.form, "where": e.where.of(lang)} for e in block.equations],
        "tables": [table for table in laid_out_tables if table["rows"]],
        "figures": [plots.lay_out_figure(figure, lang) for figure in block.figures],
        "notes": [note.of(lang) for note in block.notes],
    }


def _as_found(certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Rows as found and as left, or what the profile states instead."""
    validation = certificate.as_found
    statement = certificate.profile.adjustment.statement
    if validation is None:
        return {"statement": statement, "tables": [], "notes": []}
    notes = [
        Words(
            "As found: without the coefficients of this certificate (raw, or with those before). As"
            " left: with them. The logs are other data than those the coefficients were fitted to."
        )
    ]
    notes += map(_criterion, validation.criteria)
    if validation.flags:
        notes.append(circumstances.describe_remarks(len(validation.flags), VALIDATION))
    validation_tables = [
        _before_after(
            validation.rows,
            Words("Validation on logs that were not fitted"),
            lang,
        )
    ]
    if validation.check_points:
        validation_tables.append(
            _before_after(validation.check_points, Words("Check points"), lang)
        )
    return {
        "statement": statement,
        "tables": validation_tables,
        "notes": [note.of(lang) for note in notes],
    }


def _criterion(criterion: Criterion) -> Words:
    """An acceptance limit of the recipe, and whether the result meets it."""
    name, passed = names.name_criterion(criterion.name), criterion.passed
    is_stated = criterion.set_by == "recipe"
    limit_source = Words("Limit of the recipe") if is_stated else Words("Limit of the evaluation")
    value_text, limit = tables.format_beside(criterion.value, criterion.limit, is_stated=is_stated)
    bound = with_unit(limit, unit_mark(criterion.unit))
    verdict = Words("met") if passed else Words("NOT met")
    return Words(
        "{limit_source}: {name} {value_text} against {bound}: {verdict}.",
        limit_source=limit_source,
        name=name,
        value_text=value_text,
        bound=bound,
        verdict=verdict,
    )


def _before_after(rows: Sequence[BeforeAfter], title: Words, lang: Lang) -> dict[str, Any]:
    """Table of as-found and as-left results; U where the validation states one."""
    certain = any(row.left_u is not None for row in rows)
    table_rows = []
    for row in rows:
        before, after = (tables.format_plain(value, 3) for value in (row.as_found, row.as_left))
        u = ["", ""] if certain else []
        if row.left_u and row.as_left is not None:
            after, *u = map(tables.format_number, gum.rounded(row.as_left, row.left_u))
            u.append(tables.format_coverage(row.left_k))
            if row.as_found is not None:
                before = tables.format_number(gum.rounded(row.as_found, row.left_u)[0])
        table_rows.append(
            [row.log, row.quantity.of(lang), before, after, *u, unit_mark(row.unit) or "1"]
        )
    expanded = [tables.U, tables.K] if certain else []
    heads = [Words(""), Words(""), AS_FOUND, AS_LEFT, *expanded, tables.UNIT]
    align = "llrrrrl" if certain else "llrrl"
    note = Words("U = k·u of the as-left results, coverage probability about 95 %.")
    return tables.text_table(
        heads, align, table_rows, lang, title=title, notes=[note] if certain else []
    )


def _conformity(certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Statements of conformity, with the decision rules that they rest on and their risks."""
    statements = certificate.statements
    if not statements:
        text = Words("No statement of conformity was asked for.")
        return {"text": text.of(lang), "table": None, "rules": []}
    text = Words("Compared without rounding, in the unit of the limits.")
    rows = [_judged_row(statement, lang) for statement in statements]
    rules = sorted({s.rule for s in statements})
    return {
        "text": text.of(lang),
        "table": tables.text_table(CONFORMITY_HEADS, "llrrrllll", rows, lang),
        "rules": [
            f"{(conformity.RULES[rule] + Words('. ') + conformity.RISKS[rule]).of(lang)}"
            for rule in rules
        ],
    }


def _judged_row(s: ConformityStatement, lang: Lang) -> list[str]:
    """Row of one statement of conformity."""
    limits = (s.specification.lower, s.specification.upper)
    limit_texts = [None if limit is None else tables.format_exact(limit) for limit in limits]
    accepted = [
        tables.format_acceptance(*pair, s.result) for pair in zip(s.acceptance, limits, strict=True)
    ]
    return [
        names.name_result(s.result).of(lang),
        " ".join(filter(None, (s.specification.name, s.specification.source))),
        *tables.format_stated(s.result),
        with_unit(tables.format_limits(*limit_texts), unit_mark(s.result.unit)),
        tables.format_limits(*accepted),
        conformity.RULE_NAMES[s.rule].of(lang),
        conformity.VERDICTS[s.verdict].of(lang) + (f": {s.reason.of(lang)}" if s.reason.en else ""),
    ]


def _budgets(certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Budgets of the principal results and of the kinds that statements of conformity rest on, one
    condition of each.
    """
    budget_results = {r.quantity: r for r in certificate.results if r.principal}
    for statement in certificate.statements:
        budget_results.setdefault(statement.result.quantity, statement.result)
    notes = []
    if certificate.unused_terms:
        term_names = ", ".join(certificate.unused_terms)
        notes.append(
            Words(
                "Type B terms that enter no result of this certificate: {term_names}.",
                term_names=term_names,
            ).of(lang)
        )
    if reason := certificate.without_type_b.of(lang):
        notes.append(reason)
    return {
        "heads": [
            Words("contribution").of(lang),
            Words("type").of(lang),
            Words("distribution").of(lang),
            "u(x)",
            "c",
            "|c|·u(x)",
            "ν",
        ],
        "budgets": [
            tables.lay_out_budget(r, r.uncertainty, lang)
            for r in budget_results.values()
            if r.uncertainty is not None
        ],
        "notes": notes,
    }


def _data(certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Digests: attachments, run, logs; acceptance limits and flags of the fit."""
    run = certificate.run
    files = [[a.name, names.name_file(a.name).of(lang), a.sha256] for a in certificate.attachments]
    logs = [[log.name, str(log.rows), log.sha256] for log in run.inputs]
    if certificate.as_found is not None:
        word = Words("validation").of(lang)
        logs += [
            [f"{log.name} ({word})", str(log.rows), log.sha256] for log in certificate.as_found.logs
        ]
    notes = [
        run.content_digest.of(lang),
        Words("Coefficients hold from {date}", date=run.effective_from).of(lang),
    ]
    notes += [certificate.verdict.of(lang)]
    notes += [_criterion(criterion).of(lang) for criterion in run.criteria]
    if remarks := circumstances.describe_remarks(len(run.flags), RUN_FILE).of(lang):
        notes.append(remarks)
    heads = [Words("file"), Words("content"), Words.literal("SHA-256")]
    log_heads = [Words("log"), Words("rows"), Words.literal("SHA-256")]
    return {
        "heads": [h.of(lang) for h in heads],
        "files": files,
        "log_heads": [h.of(lang) for h in log_heads],
        "logs": logs,
        "notes": notes,
    }


def _amendment(profile: Profile, lang: Lang) -> dict[str, Any] | None:
    """Which certificate this one replaces, and what changed."""
    numbering = profile.certificate
    if not numbering.amends:
        return None
    issued = f" ({numbering.amends_issued})" if numbering.amends_issued else ""
    text = Words(
        "This certificate replaces certificate {amends}{issued}, which is no longer valid.",
        amends=numbering.amends,
        issued=issued,
    )
    return {
        "text": text.of(lang),
        "changes": [change for change in numbering.changes if change.strip()],
    }
