"""A certificate in the words of one language or both: the JSON object that the PDF's template sets
in type.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from calibkit.certificate import conformity, plots, tables
from calibkit.certificate.results import ListTable
from calibkit.certificate.words import Words, unit_mark
from calibkit.numeric import gum

if TYPE_CHECKING:
    from collections.abc import Iterable

    from calibkit.certificate.as_found import BeforeAfter
    from calibkit.certificate.content import Certificate
    from calibkit.certificate.profile import Party, Profile
    from calibkit.certificate.results import Block, Result
    from calibkit.certificate.words import Lang

Rows = list[list[str]]

HEADINGS = {
    "parties": Words("Laboratory and customer", "实验室与客户"),
    "item": Words("Item calibrated", "被校件"),
    "method": Words("Method", "校准方法"),
    "conditions": Words("Conditions", "校准条件"),
    "traceability": Words("Traceability", "溯源性"),
    "results": Words("Results", "校准结果"),
    "as_found": Words("As found and as left", "调整前与调整后"),
    "conformity": Words("Conformity", "符合性声明"),
    "budget": Words("Uncertainty budget", "不确定度评定"),
    "data": Words("Data and digests", "数据与摘要"),
    "authorisation": Words("Authorisation", "批准"),
    "amendment": Words("Amendment", "修改说明"),
    "missing": Words("Missing for a certificate", "尚缺内容"),
    "remarks": Words("Remarks", "备注"),
}
SENTENCES = {
    "draft": Words("DRAFT", "草稿"),
    "draft_line": Words("DRAFT: not a calibration certificate", "草稿：非正式校准证书"),
    "number": Words("Certificate number", "证书编号"),
    "page": Words("Page {n} of {N}", "第 {n} 页，共 {N} 页"),
    "end": Words("End of certificate", "证书结束"),
    "signature": Words("Signature", "签名"),
    "only_item": Words(
        "The results relate only to the item calibrated, as it was when it was calibrated.",
        "结果仅与被校件及其校准时的状态有关。",
    ),
    "uncertainty": Words(
        "The expanded uncertainty U is the combined standard uncertainty times the coverage factor"
        " k that stands with each table, for a coverage probability of about 95 %. It combines the"
        " uncertainty of the fit (type A, from its covariance) with what is known of the equipment"
        " (type B). It holds at the time and under the conditions of the calibration; the item's"
        " long-term stability is not in it.",
        "扩展不确定度 U 为合成标准不确定度乘以各表所示包含因子 k，包含概率约 95 %。"
        "其中包括拟合不确定度（A 类，来自协方差）"
        "与设备不确定度（B 类），仅对校准时的时间与条件有效，不含被校件的长期稳定性。",
    ),
    "attached": Words(
        "The files below are attached to this PDF. The coefficients in them have all their digits"
        " and their covariance.",
        "以下文件附于本 PDF 中，其中的系数含全部有效数字及协方差。",
    ),
}


def sheet(certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """JSON object of a certificate."""
    profile = certificate.profile
    return {
        "lang": "zh" if lang == "zh" else "en",
        "draft": certificate.draft,
        "title": certificate.title.of(lang),
        "number": profile.certificate.number,
        "laboratory": profile.laboratory.name,
        "words": {
            key: words.of(lang)
            for key, words in (HEADINGS | {f"s_{k}": v for k, v in SENTENCES.items()}).items()
        },
        "missing": [[m.key, m.what.of(lang)] for m in certificate.missing],
        "rejected": certificate.rejection.of(lang),
        "amendment": _amendment(profile, lang),
        "parties": [
            _party(profile.laboratory, lang, laboratory=True),
            _party(profile.customer, lang, laboratory=False),
        ],
        "item": _item(certificate, lang),
        "method": _method(certificate, lang),
        "conditions": _conditions(certificate, lang),
        "traceability": _traceability(profile, lang),
        "blocks": [_block(block, certificate, lang) for block in certificate.blocks],
        "as_found": _as_found(certificate, lang),
        "conformity": _conformity(certificate, lang),
        "budgets": _budgets(certificate, lang),
        "data": _data(certificate, lang),
        "remarks": [text for text in profile.remarks if text.strip()],
        "authorisation": _authorisation(certificate, lang),
    }


def _party(party: Party, lang: Lang, *, laboratory: bool) -> Rows:
    """Name, address and how to reach; of the laboratory the place of work too."""
    who = Words("Laboratory", "实验室") if laboratory else Words("Customer", "客户")
    place = getattr(party, "place_of_work", "")
    rows = [
        (who, party.name),
        (Words("Address", "地址"), party.address),
        (Words("Country", "国家"), party.country),
        *([(Words("Place of work", "校准地点"), place)] if laboratory else []),
        (Words("E-mail", "电子邮件"), party.email),
        (Words("Telephone", "电话"), party.phone),
    ]
    needed = 4 if laboratory else 2
    return [
        [words.of(lang), text]
        for k, (words, text) in enumerate(rows)
        if text.strip() or (k < needed and k != 2)
    ]


def _item(certificate: Certificate, lang: Lang) -> Rows:
    """What was calibrated, in which state, when."""
    item, dates, run = certificate.profile.item, certificate.profile.dates, certificate.run
    performed = str(dates.performed or "") + (
        f" … {dates.performed_until}" if dates.performed_until else ""
    )
    rows = [
        (Words("Item", "名称"), item.type),
        (Words("Maker", "制造商"), item.maker),
        (Words("Model", "型号"), item.model),
        (Words("Serial number", "编号"), run.serial),
        *([(Words("Identification", "标识"), item.identification)] if item.identification else []),
        (Words("Condition", "状态"), item.condition),
        *([(Words("Received", "接收日期"), str(dates.received))] if dates.received else []),
        (Words("Calibrated", "校准日期"), performed),
        (Words("Issued", "签发日期"), str(certificate.issued)),
    ]
    return [[words.of(lang), text] for words, text in rows]


def _method(certificate: Certificate, lang: Lang) -> Rows:
    """Procedure with revision, software, deviations, external providers, what was left out."""
    method, run = certificate.profile.method, certificate.run
    rows = [
        (Words("Method", "方法"), method.name),
        (Words("Revision", "版本"), method.revision),
        (
            Words("Evaluation", "数据处理"),
            f"{run.software}, {run.recipe} ({run.procedure}), {run.name}",
        ),
        (Words("Deviations from the method", "对方法的偏离"), method.deviations),
        (Words("From external providers", "外部提供的部分"), method.external_providers),
        *(
            (Words("Left out", "剔除数据"), f"{what}: {why} ({person})")
            for what, why, person in run.excluded
        ),
    ]
    return [[words.of(lang), text] for words, text in rows]


CONDITIONS = (
    ("chamber", Words("Chamber set points and holds", "温箱设定点与保温")),
    ("laboratory_temperature", Words("Laboratory temperature", "实验室温度")),
    ("local_gravity", Words("Local gravity", "当地重力加速度")),
    ("latitude", Words("Latitude", "纬度")),
    ("earth_rate", Words("Earth's rate", "地球自转")),
    ("supply", Words("Supply", "供电")),
    ("warm_up", Words("Warm-up", "预热")),
)


def _conditions(certificate: Certificate, lang: Lang) -> Rows:
    """What the profile states, and what the coefficient files hold."""
    stated = certificate.profile.conditions
    rows = [[words.of(lang), getattr(stated, key)] for key, words in CONDITIONS]
    rows += [["", text] for text in stated.others if text.strip()]
    for condition in certificate.run.conditions:
        label = Words("In the computation: ", "计算中采用：") + Words(
            condition.name.replace("_", " ")
        )
        unit = unit_mark(condition.unit)
        text = f"{tables.plain(condition.value, 8)} {unit}".strip()
        if condition.standard_uncertainty > 0.0:
            said = Words("standard uncertainty", "标准不确定度").of(lang)
            text += (
                f" ({said} {f'{tables.plain(condition.standard_uncertainty, 2)} {unit}'.strip()})"
            )
        rows.append([label.of(lang), text])
    return rows


def _traceability(profile: Profile, lang: Lang) -> dict[str, Any]:
    """Standards with their certificates."""
    heads = [
        Words("Standard", "标准器"),
        Words("Serial", "编号"),
        Words("Certificate", "证书编号"),
        Words("Date", "日期"),
        Words("Laboratory", "校准机构"),
    ]
    rows = []
    for s in profile.standard:
        until = (
            Words(" (valid until ", "（有效期至 ").of(lang) + f"{s.valid_until})"
            if s.valid_until
            else ""
        )
        rows.append([s.name, s.serial, s.certificate, f"{s.date or ''}{until}", s.laboratory])
    return {
        "title": "",
        "groups": [],
        "heads": [h.of(lang) for h in heads],
        "align": ["left"] * 5,
        "rows": rows,
        "notes": [],
    }


def _block(block: Block, certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Equation, tables, figures and notes of one coefficient file."""
    shown: list[dict[str, Any]] = []
    for table in block.tables:
        shown += (
            [tables.of_list(table, lang)]
            if isinstance(table, ListTable)
            else tables.of_grid(table, lang)
        )
    digest = next((a.sha256 for a in certificate.attachments if a.name == block.file), "")
    return {
        "title": block.title.of(lang),
        "file": block.file,
        "sha256": digest,
        "equations": [{"form": e.form, "where": e.where.of(lang)} for e in block.equations],
        "tables": [table for table in shown if table["rows"]],
        "figures": [
            plots.drawing(figure, lang)
            for figure in block.figures
            if any(s.x for s in figure.series)
        ],
        "notes": [note.of(lang) for note in block.notes],
    }


def _as_found(certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Rows before and after, or what the profile says instead."""
    found = certificate.as_found
    statement = certificate.profile.adjustment.statement
    if found is None:
        return {"statement": statement, "tables": [], "notes": []}
    notes = [
        Words(
            "As found: without the coefficients of this certificate (raw, or with those before). As"
            " left: with them. The logs are other data than those the coefficients were fitted to.",
            "调整前：未使用本证书系数；调整后：使用本证书系数。所用数据与拟合数据不同。",
        )
    ]
    notes += [
        _criterion(name, value, limit, unit, passed=passed)
        for name, value, limit, unit, passed in found.criteria
    ]
    notes += [Words(flag) for flag in found.flags]
    shown = [
        _before_after(
            found.rows,
            Words("Validation on logs that were not fitted", "未参与拟合数据的验证"),
            lang,
        )
    ]
    if found.check_points:
        shown.append(_before_after(found.check_points, Words("Check points", "检验点"), lang))
    return {"statement": statement, "tables": shown, "notes": [note.of(lang) for note in notes]}


def _criterion(name: str, value: float, limit: float, unit: str, *, passed: bool) -> Words:
    """An acceptance limit of the recipe, and how the result stands against it."""
    shown, bound = tables.beside(value, limit), f"{tables.exact(limit)} {unit_mark(unit)}".strip()
    return Words(
        f"Limit of the recipe: {name} {shown} against {bound}: {'held' if passed else 'NOT held'}.",
        f"配方限值：{name} {shown}，限值 {bound}：{'满足' if passed else '不满足'}。",
    )


def _before_after(rows: Iterable[BeforeAfter], title: Words, lang: Lang) -> dict[str, Any]:
    """Table of as-found and as-left results; U where the validation states one."""
    listed = list(rows)
    certain = any(row.left_u is not None for row in listed)
    heads = [
        Words("as found", "调整前"),
        Words("as left", "调整后"),
        *([tables.U] if certain else []),
        Words("unit", "单位"),
    ]
    shown = []
    for row in listed:
        unit = unit_mark(row.unit) or "1"
        before, after = tables.plain(row.found, 3), tables.plain(row.left, 3)
        u = [""] if certain else []
        if row.left_u and row.left is not None:
            after, expanded = (tables.number(text) for text in gum.rounded(row.left, row.left_u))
            u = [expanded]
            if row.found is not None:
                before = tables.number(gum.rounded(row.found, row.left_u)[0])
        shown.append([row.log, row.what.of(lang), before, after, *u, unit])
    align = ["left", "left", "right", "right", *(["right"] if certain else []), "left"]
    labels = ["", "", *(head.of(lang) for head in heads)]
    notes = (
        [Words("U with k = 2 (type A of the validation).", "U：k = 2（验证的 A 类）。").of(lang)]
        if certain
        else []
    )
    return {
        "title": title.of(lang),
        "groups": [],
        "heads": labels,
        "align": align,
        "rows": shown,
        "notes": notes,
    }


def _conformity(certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Statements, with the decision rules that they rest on."""
    if not certificate.statements:
        text = Words("No statement of conformity was asked for.", "未要求符合性声明。")
        return {"text": text.of(lang), "table": None, "rules": []}
    heads = [
        Words("result", "结果"),
        Words("specification", "技术要求"),
        Words("value", "值"),
        Words("U"),
        Words("limits", "允许范围"),
        Words("acceptance limits", "接受限"),
        Words("rule", "规则"),
        Words("statement", "结论"),
    ]
    rows = []
    for s in certificate.statements:
        value, U = tables.cells(s.result)
        unit = unit_mark(s.result.unit)
        verdict = conformity.VERDICTS[s.verdict].of(lang) + (
            f": {s.reason.of(lang)}" if s.reason.en else ""
        )
        named = " ".join(filter(None, (s.name, s.source)))
        stated = [None if limit is None else tables.exact(limit) for limit in (s.lower, s.upper)]
        limits = f"{tables.limits(*stated)} {unit}".strip()
        accepted = [
            tables.acceptance(*pair, s.result)
            for pair in zip(s.acceptance, (s.lower, s.upper), strict=True)
        ]
        rows.append(
            [
                tables.breakable(s.result.key),
                named,
                value,
                U,
                limits,
                tables.limits(*accepted),
                s.rule.replace("_", "-"),
                verdict,
            ]
        )
    rules = [
        f"{conformity.RULES[rule].of(lang)}."
        for rule in sorted({s.rule for s in certificate.statements})
    ]
    text = Words(
        "Compared without rounding, in the unit of the limits.", "以未修约数值比较，单位同限值。"
    )
    align = ["left", "left", "right", "right", "left", "left", "left", "left"]
    table = {
        "title": "",
        "groups": [],
        "heads": [h.of(lang) for h in heads],
        "align": align,
        "rows": rows,
        "notes": [],
    }
    return {"text": text.of(lang), "table": table, "rules": rules}


def _budgets(certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Budgets of the principal results and of the kinds that statements of conformity rest on, one
    condition of each.
    """
    chosen = {_kind(r): r for r in certificate.results if r.principal}
    for statement in certificate.statements:
        chosen.setdefault(_kind(statement.result), statement.result)
    notes = []
    if certificate.unused_terms:
        listed = ", ".join(certificate.unused_terms)
        notes.append(
            Words(
                f"Type B terms that enter no result of this certificate: {listed}.",
                f"未用于本证书结果的 B 类分量：{listed}。",
            ).of(lang)
        )
    return {
        "heads": [
            Words("contribution", "分量").of(lang),
            Words("type", "类").of(lang),
            Words("distribution", "分布").of(lang),
            "u(x)",
            "c",
            "|c|·u(x)",
            "ν",
        ],
        "budgets": [
            tables.budget(r, r.uncertainty, lang)
            for r in chosen.values()
            if r.uncertainty is not None
        ],
        "notes": notes,
    }


def _kind(result: Result) -> str:
    """A result's key without the condition that it holds at."""
    return result.key.partition("@")[0]


def _data(certificate: Certificate, lang: Lang) -> dict[str, Any]:
    """Digests: attachments, run, logs; acceptance limits and flags of the fit."""
    run = certificate.run
    files = [[a.name, a.description, a.sha256] for a in certificate.attachments]
    logs = [[name, str(rows), digest] for name, digest, rows in run.inputs]
    if certificate.as_found is not None:
        word = Words("validation", "验证").of(lang)
        logs += [
            [f"{name} ({word})", str(rows), digest]
            for name, digest, rows in certificate.as_found.logs
        ]
    notes = [
        run.content_digest.of(lang),
        Words("Coefficients hold from ", "系数生效日期 ").of(lang) + run.effective_from,
    ]
    for name, value, limit, unit, passed in run.criteria:
        notes.append(_criterion(name, value, limit, unit, passed=passed).of(lang))
    heads = [Words("file", "文件"), Words("content", "内容"), Words("SHA-256")]
    log_heads = [Words("log", "数据"), Words("rows", "行数"), Words("SHA-256")]
    return {
        "heads": [h.of(lang) for h in heads],
        "files": files,
        "log_heads": [h.of(lang) for h in log_heads],
        "logs": logs,
        "notes": notes,
        "flags": list(run.flags),
    }


def _amendment(profile: Profile, lang: Lang) -> dict[str, Any] | None:
    """Which certificate this one replaces, and what changed."""
    stated = profile.certificate
    if not stated.amends:
        return None
    issued = f" ({stated.amends_issued})" if stated.amends_issued else ""
    text = Words(
        f"This certificate replaces certificate {stated.amends}{issued}, which is no longer valid.",
        f"本证书替代证书 {stated.amends}{issued}，原证书作废。",
    )
    return {
        "text": text.of(lang),
        "changes": [change for change in stated.changes if change.strip()],
    }


def _authorisation(certificate: Certificate, lang: Lang) -> Rows:
    """Who authorises it, as what, when."""
    person = certificate.profile.authorised_by
    rows = [
        (Words("Authorised by", "批准人"), person.name),
        (Words("Role", "职务"), person.role),
        (Words("Date of issue", "签发日期"), str(certificate.issued)),
    ]
    return [[words.of(lang), text] for words, text in rows]
