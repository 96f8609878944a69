"""The pages: devices, one device over the years, then and now, one run."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlencode

from calibkit.viewer.index import REPORTS
from calibkit.viewer.markup import Content, Markup, element, join_markup, summary_table

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from calibkit.records.store import StoredRun
    from calibkit.viewer.index import Entry

A_PAGE = 100
"""Devices of one page."""
KINDS = {"accepted": "accepted", "rejected": "rejected", "no verdict": "", "": "fault"}
"""Verdict → class of its cell."""
ANSWERS = {"yes": "yes", "no": "no", "cannot tell": "unknown"}


def style() -> bytes:
    """Styles of the report's page and of these."""
    viewer_css = resources.files("calibkit.viewer").joinpath("viewer.css").read_bytes()
    return resources.files("calibkit.report").joinpath("page.css").read_bytes() + viewer_css


def _page(title: str, body: Iterable[Markup], trail: Sequence[tuple[str, str]] = ()) -> bytes:
    """A page with the way back."""
    way = [element("a", name, href=path) for name, path in trail]
    head = [
        Markup('<meta charset="utf-8">'),
        Markup('<meta name="viewport" content="width=device-width, initial-scale=1">'),
        Markup('<meta name="color-scheme" content="light dark">'),
        element("title", f"{title} · calibkit"),
        Markup('<link rel="stylesheet" href="/style.css">'),
    ]
    main = [
        *(
            [element("nav", join_markup(way, " › "), class_="trail", aria_label="Way")]
            if way
            else []
        ),
        element("header", element("h1", title)),
        element("main", join_markup(body)),
    ]
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{join_markup(head)}\n</head>\n'
        f"<body>\n{join_markup(main)}\n</body>\n</html>\n"
    ).encode()


def show_message(title: str, text: str) -> bytes:
    """A page with one sentence."""
    return _page(title, [element("p", text)], [("Devices", "/")])


def _table(heads: Sequence[str], rows: Iterable[Sequence[Markup]]) -> Markup:
    """A table that becomes a list of cards on a narrow screen: the first cell of a row is its
    head.
    """
    head = element("tr", join_markup(element("th", name, scope="col") for name in heads))
    lines = []
    for first, *other_cells in rows:
        cells = [element("th", first, scope="row")]
        for name, cell in zip(heads[1:], other_cells, strict=True):
            cells.append(element("td", cell, data_head=name) if cell.text else Markup("<td></td>"))
        lines.append(element("tr", join_markup(cells)))
    body = element("tbody", join_markup(lines))
    return element("table", element("thead", head), body, class_="list")


def _text(text: object) -> Markup:
    """A text, escaped."""
    return element("span", str(text)) if str(text) else Markup("")


def _verdict(entry: Entry) -> Markup:
    """Verdict of a run, or why it cannot be read."""
    if entry.fault:
        return element("span", entry.fault, class_="fault")
    failed_note = f": {entry.failed}" if entry.failed else ""
    return element("span", entry.verdict + failed_note, class_=KINDS.get(entry.verdict, ""))


def list_devices(
    entries_by_serial: Mapping[str, Sequence[Entry]], query: Mapping[str, str]
) -> bytes:
    """Devices with their newest run; `asked` may hold a search, a verdict and the number of a
    page.
    """
    newest = {serial: entries[-1] for serial, entries in entries_by_serial.items()}
    words, verdict_filter = query.get("q", "").casefold().split(), query.get("verdict", "all")
    hits = [
        entry
        for entry in newest.values()
        if all(word in _searched(entry) for word in words)
        and verdict_filter in ("all", entry.verdict or "cannot be read")
    ]
    number = query.get("page", "1")
    last = max(-(-len(hits) // A_PAGE), 1)
    page = min(max(int(number), 1), last) if number.isdecimal() and len(number) < 9 else 1
    page_entries = hits[(page - 1) * A_PAGE : page * A_PAGE]
    runs = sum(map(len, entries_by_serial.values()))
    body = [
        element("p", f"{len(entries_by_serial)} devices, {runs} runs. The newest run of each:"),
        _counts(newest.values(), verdict_filter, query.get("q", "")),
        _search(query.get("q", ""), verdict_filter),
        _table(
            ("device", "verdict", "effective from", "procedure", "type", "runs"),
            (
                (
                    element("a", entry.serial, href=f"/device/{quote(entry.serial)}"),
                    _verdict(entry),
                    _text(entry.effective_from),
                    _text(entry.procedure),
                    _text(entry.type),
                    _text(len(entries_by_serial[entry.serial])),
                )
                for entry in page_entries
            ),
        )
        if page_entries
        else element("p", "No device is like that."),
        *([_pages(page, last, query)] if last > 1 else []),
    ]
    return _page("Devices", body)


def _searched(entry: Entry) -> str:
    """Where words are searched."""
    return f"{entry.serial} {entry.procedure} {entry.type} {entry.effective_from}".casefold()


def _counts(newest: Iterable[Entry], verdict_filter: str, query: str) -> Markup:
    """How many devices have which verdict, each a link to them."""
    verdicts = [entry.verdict or "cannot be read" for entry in newest]
    lines = []
    for name in ("all", *dict.fromkeys(sorted(verdicts))):
        count = len(verdicts) if name == "all" else verdicts.count(name)
        parts: tuple[Content, ...] = (element("strong", str(count)), f" {name}")
        link = "/?" + urlencode({"verdict": name, "q": query})
        label = element("b", *parts) if name == verdict_filter else element("a", *parts, href=link)
        lines.append(element("li", label))
    return element("ul", join_markup(lines), class_="counts")


def _search(query: str, verdict_filter: str) -> Markup:
    """Form that searches."""
    field = _input(id="q", name="q", type="search", value=query)
    return element(
        "form",
        element(
            "div",
            element("label", "Serial, procedure, type or date", for_="q"),
            field,
        ),
        _input(type="hidden", name="verdict", value=verdict_filter),
        element("button", "Search"),
        action="/",
        role="search",
    )


def _input(**attributes: str) -> Markup:
    """A field of a form, which has no end tag."""
    return Markup(element("input", **attributes).text.removesuffix("</input>"))


def _pages(page: int, last: int, query: Mapping[str, str]) -> Markup:
    """Links to the pages before and after."""

    def link(name: str, number: int) -> Markup:
        return element("a", name, href="/?" + urlencode({**query, "page": number}))

    parts = [
        *([link("‹ before", page - 1)] if page > 1 else []),
        element("span", f"page {page} of {last}"),
        *([link("after ›", page + 1)] if page < last else []),
    ]
    return element("nav", join_markup(parts, " "), aria_label="Pages")


def show_device(serial: str, entries: Sequence[Entry], runs: Path) -> bytes:
    """Runs of a device, whether it is still good since the run before, key values over the
    years.
    """
    rows = (
        (
            element("a", entry.revision, href=f"/run/{quote(serial)}/{entry.revision}"),
            _verdict(entry),
            _text(entry.effective_from),
            _text(entry.procedure),
            _text(entry.logs),
            element("a", "report", href=f"/run/{quote(serial)}/{entry.revision}/{entry.report}")
            if entry.report
            else Markup(""),
        )
        for entry in reversed(entries)
    )
    body = [
        *_latest_answer(serial, entries, runs),
        element("h2", "Runs"),
        _table(("run", "verdict", "effective from", "procedure", "logs", "report"), rows),
        *_history(serial, entries, runs),
    ]
    return _page(serial, body, [("Devices", "/")])


def _latest_answer(serial: str, entries: Sequence[Entry], runs: Path) -> list[Markup]:
    """The answer on the two newest runs, and a form for any two."""
    usable = [entry.revision for entry in entries if not entry.fault]
    if len(usable) < 2:
        return []
    old, new = usable[-2:]
    return [
        _answer(serial, old, new, runs)[0],
        _choose_two(serial, usable, old, new),
    ]


def _answer(serial: str, old: str, new: str, runs: Path) -> tuple[Markup, list[Markup]]:
    """The sentence on two runs, and the rest of their comparison; why there is none where a run
    cannot be used.
    """
    from calibkit.errors import CalibkitError
    from calibkit.records import store
    from calibkit.results import comparison, still_good

    try:
        earlier_run, later_run = (
            store.load_revision(runs, serial, int(revision[1:])) for revision in (old, new)
        )
        outcome = comparison.compare(earlier_run, later_run)
    except CalibkitError as error:
        return element("p", f"{old} and {new}: {error}", class_="band unknown"), []
    summary = still_good.summarise(outcome)
    sentence = element("strong", summary.title)
    flags = [element("li", flag) for flag in summary.flags]
    details = [
        *_chart(still_good.draw(outcome)),
        *(element("div", summary_table(table), class_="wide") for table in summary.tables),
        *([element("ul", join_markup(flags), class_="flags")] if flags else []),
    ]
    return element("p", sentence, class_=f"band {ANSWERS[outcome.answer]}"), details


def _choose_two(serial: str, usable: Sequence[str], old: str, new: str) -> Markup:
    """Form that compares two runs."""

    def select(name: str, words: str, selected: str) -> Markup:
        options = [
            Markup(
                f'<option value="{revision}"{" selected" * (revision == selected)}>'
                f"{revision}</option>"
            )
            for revision in usable
        ]
        return element(
            "div",
            element("label", words, for_=name),
            element("select", join_markup(options), id=name, name=name),
        )

    return element(
        "form",
        select("old", "then", old),
        select("new", "now", new),
        element("button", "Still good?"),
        action=f"/compare/{quote(serial)}",
    )


def show_comparison(serial: str, entries: Sequence[Entry], old: str, new: str, runs: Path) -> bytes:
    """Then and now: the answer, the figure, the table."""
    sentence, details = _answer(serial, old, new, runs)
    usable = [entry.revision for entry in entries if not entry.fault]
    trail = [("Devices", "/"), (serial, f"/device/{quote(serial)}")]
    body = [sentence, _choose_two(serial, usable, old, new), *details]
    return _page(f"{serial}: {old} and {new}", body, trail)


def _history(serial: str, entries: Sequence[Entry], runs: Path) -> list[Markup]:
    """Key values over the years."""
    from calibkit.errors import CalibkitError
    from calibkit.records import store
    from calibkit.results import key_values

    loaded, faults = [], []
    for entry in entries:
        try:
            loaded.append(store.load_revision(runs, serial, int(entry.revision[1:])))
        except CalibkitError as error:
            faults.append(str(error))
    followed, left_out = key_values.follow(loaded)
    notes = [element("li", text) for text in (*faults, *left_out)]
    note_list = [element("ul", join_markup(notes), class_="flags")] if notes else []
    table = key_values.tabulate(followed)
    if table is None:
        return note_list
    return [
        *note_list,
        element("h2", "Key values over the years"),
        *_chart(key_values.draw(serial, followed)),
        element("div", summary_table(table), class_="wide"),
    ]


def warm_up() -> None:
    """Import what comparisons and figures need, which takes longer than they do."""
    from calibkit.report import page, svg
    from calibkit.results import key_values, still_good

    del page, svg, key_values, still_good


def _chart(figure: Figure) -> list[Markup]:
    """A figure as a drawing of the page."""
    from calibkit.report import figures, svg

    title = figure.get_suptitle()
    figure.suptitle("")  # it stands above
    with figures.drawing():
        figure.draw_without_rendering()
    drawings, _ = svg.inline([figure])
    return [
        element("div", Markup(drawing), class_="chart", role="img", aria_label=title)
        for drawing in drawings
    ]


def show_run(run: StoredRun) -> bytes:
    """What a run is, its limits and flags, and its files."""
    document = run.document
    name, run_url = f"{document['serial']} r{document['revision']:03d}", f"/run/{_place(run)}"
    facts = {
        "procedure": document["procedure"],
        "effective from": document["effective_from"],
        "recipe": document["recipe"]["name"],
        "logs": ", ".join(entry["name"] for entry in document["inputs"]),
        "software": document["software"],
        "digest": document["sha256"],
    }
    pairs = [
        part for key, text in facts.items() for part in (element("dt", key), element("dd", text))
    ]
    file_names = [entry["name"] for entry in document["files"]]
    report = next((file_name for file_name in REPORTS if file_name in file_names), "")
    flags = [element("li", flag) for flag in document["flags"]]
    flagged = [element("h2", "Flags"), element("ul", join_markup(flags), class_="flags")]
    kind = {"accepted": "accepted", "rejected": "rejected"}.get(document["verdict"], "open")
    body = [
        element("p", element("strong", document["verdict"]), class_=f"band {kind}"),
        *([element("p", element("a", "Report", href=f"{run_url}/{report}"))] if report else []),
        element("dl", join_markup(pairs), class_="facts"),
        *_limits(document["acceptance"]),
        *(flagged if flags else []),
        element("h2", "Files"),
        element(
            "ul",
            join_markup(
                element("li", element("a", file_name, href=f"{run_url}/{quote(file_name)}"))
                for file_name in sorted([*file_names, "run.json"])
            ),
        ),
    ]
    serial = document["serial"]
    return _page(name, body, [("Devices", "/"), (serial, f"/device/{quote(serial)}")])


def _limits(acceptance: Sequence[Mapping[str, Any]]) -> list[Markup]:
    """Table of acceptance limits; nothing where there are none."""
    rows = [
        (
            _text(criterion["name"]),
            _text(f"{criterion['value']:.6g}"),
            _text(
                f"{criterion['limit']:.6g} {criterion['unit'] if criterion['unit'] != '1' else ''}"
            ),
            element("span", "met", class_="accepted")
            if criterion["passed"]
            else element("span", "not met", class_="rejected"),
        )
        for criterion in acceptance
    ]
    return [_table(("limit", "value", "limit at", ""), rows)] if rows else []


def _place(run: StoredRun) -> str:
    """Serial and revision as a path."""
    return f"{quote(run.document['serial'])}/r{run.document['revision']:03d}"
