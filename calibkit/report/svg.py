"""Figures as inline SVG of an HTML page: the same bytes for the same figures, no styles of their
own, thinned where long.
"""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING

import numpy as np

from calibkit.report.figures import POINTS, drawing, literal

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from xml.etree.ElementTree import Element

    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    from calibkit.numeric.arrays import Array, Integers


MOST_POINTS = 4000
"""Points up to which a curve is drawn whole."""
FEWEST_POINTS = 400
"""Points that a long curve keeps in a report of however many curves."""
ALL_POINTS = 100_000
"""Points of a report's long curves together: about 1.5 MB of it."""
PLACES = 2
"""Decimals of coordinates [pt]: a tenth of a line's width at the strongest zoom."""
CELL_PT = 0.25
"""Markers nearer to each other than this lie on each other."""

_PREFIX = re.compile(r"\{[^}]*\}")
_LONG = re.compile(rf"-?\d+\.\d{{{PLACES + 1},}}")
_URL = re.compile(r"url\(#([^)]+)\)")
_MARK = r'<use xlink:href="#{}" x="([^"]*)" y="([^"]*)" style="{}"/>\s*'
_MARKS = re.compile(
    _MARK.format(r"(?P<shape>\w+)", r'(?P<style>[^"]*)')
    + f"(?:{_MARK.format('(?P=shape)', '(?P=style)')})+"
)
_BESIDE = re.compile(r"\s*([A-Za-z])\s*| (?=-)")
_PLACE = re.compile(r' x="([^"]*)" y="([^"]*)"')
_ATTRIBUTES = frozenset(
    {
        "clip-path",
        "fill",
        "fill-opacity",
        "fill-rule",
        "font-size",
        "font-style",
        "font-weight",
        "opacity",
        "stroke",
        "stroke-dasharray",
        "stroke-dashoffset",
        "stroke-linecap",
        "stroke-linejoin",
        "stroke-miterlimit",
        "stroke-opacity",
        "stroke-width",
        "text-anchor",
    }
)
"""Properties that may be attributes, which need no permission of a content security policy; the
rest is the page's.
"""


def inline(figures: Sequence[Figure]) -> tuple[list[str], bool]:
    """SVG element of each figure, and whether long curves were thinned. The figures, which were
    drawn before, are spent.

    Where the panels lie and what their axes span stands in `data-` attributes, for a reading at the
    pointer.
    """
    lines = [
        line
        for figure in figures
        for ax in figure.axes
        if ax.get_visible()
        for line in ax.get_lines()
    ]
    max_points = int(np.clip(ALL_POINTS // max(1, len(lines)), FEWEST_POINTS, MOST_POINTS))
    thinned = [_thin(line, max_points) for line in lines]
    return [_svg(figure, f"f{number}-") for number, figure in enumerate(figures, start=1)], any(
        thinned
    )


def _thin(line: Line2D, max_points: int) -> bool:
    """Leave of a long line what shows its extremes; returns whether it was long."""
    x, y = (np.asarray(values, dtype=np.float64) for values in line.get_data(orig=False))
    if x.size <= max_points:
        return False
    joined = line.get_linestyle() not in {"None", "none", " ", ""}
    indices = (
        extremes(x, y, max_points)
        if joined
        else _apart(line.get_transform().transform(np.column_stack([x, y])), max_points)
    )
    line.set_data(x[indices], y[indices])
    return True


def extremes(x: Array, y: Array, max_points: int) -> Integers:
    """Indices, ascending, of a curve's smallest and largest x and y [n] in equal pieces, and of its
    gaps; about `most`.
    """
    sides = (y,) if np.all(np.diff(x) >= 0.0) else (x, y)
    indices = [np.array([0, x.size - 1])]
    for piece in np.array_split(np.arange(x.size), max(1, max_points // (2 * len(sides)))):
        good = piece[np.isfinite(x[piece]) & np.isfinite(y[piece])]
        if good.size < piece.size:
            indices.append(piece[~np.isin(piece, good)][:1])
        if good.size:
            indices += [
                np.array([good[np.argmin(side[good])], good[np.argmax(side[good])]])
                for side in sides
            ]
    return np.unique(np.concatenate(indices))


def _apart(points: Array, max_points: int) -> Integers:
    """Indices, ascending, of points [n, 2, pixels] that do not lie on each other; cells grow until
    at most `most` are left.
    """
    points = np.where(np.isfinite(points), points, -1.0)
    cell = CELL_PT
    while True:
        _, indices = np.unique(np.floor(points / cell), axis=0, return_index=True)
        if indices.size <= max_points:
            return np.sort(indices)
        cell *= 1.5


def _svg(figure: Figure, prefix: str) -> str:
    """SVG element of one figure whose layout was settled when it was drawn; its ids begin with a
    prefix of their own.
    """
    from xml.etree import ElementTree as ET

    import matplotlib as mpl

    from calibkit.report.svg_canvas import Renderer

    literal(figure)
    figure.set_layout_engine("none")
    for number, ax in enumerate(figure.axes):
        ax.set_gid(f"panel{number}")
    buffer = io.StringIO()
    figure.dpi = POINTS
    with drawing(), mpl.rc_context({"svg.fonttype": "none"}):
        renderer = Renderer(*figure.bbox.size, buffer)
        figure.draw(renderer)
        renderer.finalize()  # type: ignore[no-untyped-call]
    root = ET.fromstring(_join_marks(buffer.getvalue()))  # noqa: S314 - what matplotlib has just written
    _plain(root, prefix)
    for number, ax in enumerate(figure.axes):
        group = root.find(f".//g[@id='panel{number}']")
        if group is not None:
            del group.attrib["id"]
            group.attrib |= _panel(ax, figure)
    root.attrib = {"viewBox": root.get("viewBox", ""), "role": "img", "focusable": "false"}
    return ET.tostring(root, encoding="unicode").replace(" />", "/>")


def _join_marks(drawing: str) -> str:
    """An SVG of matplotlib with each run of equal marks as one path with a mark at every corner: a
    third of the bytes.
    """
    marker_names: dict[tuple[str, str], str] = {}

    def joined(match: re.Match[str]) -> str:
        shape, style = match["shape"], match["style"]
        name = marker_names.get((shape, style), "")
        definition = ""
        if not name:
            name = marker_names[shape, style] = f"{shape}at{len(marker_names)}"
            # what the style leaves out is not inherited from groups that state it for other parts
            definition = (
                f'<defs><marker id="{name}" markerUnits="userSpaceOnUse" overflow="visible">'
                f'<use xlink:href="#{shape}" style="fill: #000000; stroke: none; {style}"/>'
                "</marker></defs>"
            )
        places = np.array(_PLACE.findall(match[0]), dtype=np.float64)
        steps = np.diff(np.rint(places * 10**PLACES), axis=0, prepend=0.0) / 10**PLACES
        way = " ".join(f"{step:g}" for step in steps.ravel())
        marks = " ".join(
            f'marker-{position}="url(#{name})"' for position in ("start", "mid", "end")
        )
        return f'{definition}<path d="m{way}" style="fill: none; stroke: none" {marks}/>'

    return _MARKS.sub(joined, drawing)


def _plain(root: Element, prefix: str) -> None:
    """Make styles attributes, round coordinates, and leave only the ids that something refers to,
    with the prefix.
    """
    for parent in list(root.iter()):
        for child in list(parent):
            if _PREFIX.sub("", child.tag) in {"style", "metadata"}:
                parent.remove(child)
    names = {name: f"{prefix}{k}" for k, name in enumerate(dict.fromkeys(_references(root)))}
    for element in root.iter():
        element.tag = _PREFIX.sub("", element.tag)
        element.attrib = _attributes(element, names)
        for side in ("text", "tail"):
            if not (getattr(element, side) or "").strip():
                setattr(element, side, None)


def _references(root: Element) -> Iterator[str]:
    """Ids that elements refer to."""
    for element in root.iter():
        for name, value in element.attrib.items():
            if name.endswith("href"):
                yield value.removeprefix("#")
            yield from _URL.findall(value)


def _attributes(element: Element, names: Mapping[str, str]) -> dict[str, str]:
    """Attributes of an element without a style, coordinates rounded; `names` are those of the ids
    that something refers to.
    """
    attributes = {_PREFIX.sub("", name): value for name, value in element.attrib.items()}
    attributes |= _styled(attributes.pop("style", ""))
    output = {}
    for name, value in attributes.items():
        if name == "id":
            if value in names or value.startswith("panel"):
                output["id"] = names.get(value, value)
        elif name == "href":
            output["href"] = f"#{names[value.removeprefix('#')]}"
        elif not (name == "transform" and value.startswith("rotate(-0 ")):
            rounded = _LONG.sub(_rounded, value).strip()
            output[name] = _URL.sub(lambda match: f"url(#{names[match[1]]})", rounded)
    if "d" in output:
        output["d"] = _BESIDE.sub(r"\1", output["d"])
    return output


def _styled(style: str) -> dict[str, str]:
    """Declarations of a style that are attributes too."""
    pairs = (part.partition(":") for part in style.split(";"))
    return {name.strip(): value.strip() for name, _, value in pairs if name.strip() in _ATTRIBUTES}


def _rounded(match: re.Match[str]) -> str:
    """A coordinate with the decimals that can be seen."""
    text = f"{float(match.group()):.{PLACES}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def _panel(ax: Axes, figure: Figure) -> dict[str, str]:
    """Where a panel lies in the SVG and what its axes span: class and data attributes; nothing for
    a panel without axes.
    """
    if not ax.get_visible() or not ax.axison:
        return {}
    width, height = (72.0 * size for size in figure.get_size_inches())
    box = ax.get_position()
    place = (box.x0 * width, (1.0 - box.y1) * height, box.width * width, box.height * height)
    titles = (ax.get_title(loc) for loc in ("left", "center", "right"))
    return {
        "class": "panel",
        "data-box": " ".join(_LONG.sub(_rounded, f"{part:.6f}") for part in place),
        "data-name": " ".join(filter(None, titles)),
        "data-x": _span(ax.xaxis, ax.get_xlim()),
        "data-y": _span(ax.yaxis, ax.get_ylim()),
        "data-x-label": ax.get_xlabel() or "x",
        "data-y-label": ax.get_ylabel() or "y",
    }


def _span(axis: Axis, limits: tuple[float, float]) -> str:
    """Scale and limits of an axis as words; nothing where it counts names or has a scale that the
    page does not know.
    """
    scale = axis.get_scale()
    labels = [label.get_text().replace("−", "-") for label in axis.get_ticklabels()]
    if any(re.fullmatch(r"[-+.\deE]*|\$.*\$", label) is None for label in labels):
        return ""
    ends = f"{float(limits[0])!r} {float(limits[1])!r}"
    if scale == "symlog":
        return f"symlog {ends} {float(axis.get_transform().linthresh)!r}"  # type: ignore[attr-defined]
    return f"{scale} {ends}" if scale in {"linear", "log"} else ""
