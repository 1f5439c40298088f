"""The page all reports share: a first screen that answers the question, the evidence under it, one file, offline.

A figure is plain plotly JSON whose colours are names such as ``@measured``; the page fills in the colour of the
reader's theme and does so again when the theme changes and when it is printed.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..checks import CALLED, IMPOSSIBLE, NOTE, SET_ASIDE, WARNING, Finding
from ..core.plain_json import script_text


@dataclass(frozen=True)
class Figure:
    """A plot: plotly ``data`` and ``layout``, what it shows in words (for who cannot see it), its height in px.

    ``fixed`` is for one that nobody would zoom into.
    """

    data: list[dict[str, Any]]
    layout: dict[str, Any]
    label: str
    height: int = 320
    fixed: bool = False


@dataclass
class Page:
    """A report under construction: ``kind`` and ``title`` over the ``verdict``, one sentence, and ``lead``, HTML.

    ``findings`` are what a look at the data found, said over the lead;
    ``notes`` are what was converted or left out while the data were read, plain text, one line each.
    """

    title: str
    kind: str
    verdict: str
    tone: str = "neutral"
    lead: str = ""
    notes: Sequence[str] = ()
    findings: Sequence[Finding] = ()
    foot: str = ""
    _figures: list[Figure] = field(default_factory=list)
    _parts: list[str] = field(default_factory=list)
    _links: list[tuple[str, str]] = field(default_factory=list)
    _data: dict[str, Any] = field(default_factory=dict)
    _scripts: list[str] = field(default_factory=list)
    _picture: str = ""

    def figure(self, figure: Figure, caption: str = "") -> str:
        """Register a figure and return the HTML that stands for it. ``caption`` is HTML."""
        number = len(self._figures)
        self._figures.append(figure)
        below = f"<figcaption>{caption}</figcaption>" if caption else ""
        return (
            f'<figure><div class="plot" id="plot-{number}" data-figure="{number}" tabindex="0" role="img" '
            f'aria-label="{escape(figure.label)}" style="height:{figure.height}px"></div>{below}</figure>'
        )

    def picture(self, html: str) -> None:
        """What stands beside the verdict on the first screen."""
        self._picture = html

    def section(self, title: str, html: str, name: str = "") -> None:
        """Add a section of evidence. ``html`` is trusted: escape what a user gave with `text`."""
        name = name or "".join(c if c.isalnum() else "-" for c in title.lower()).strip("-")
        self._links.append((name, title))
        self._parts.append(f'<section id="{name}"><h2>{escape(title)}</h2>{html}</section>')

    def script(self, file: str, name: str, data: Any) -> None:
        """Add a script of `static/`, which finds ``data`` under ``name``."""
        if file not in self._scripts:
            self._scripts.append(file)
        self._data[name] = data

    def render(self) -> str:
        """The whole page."""
        figures = [{"data": f.data, "layout": f.layout, "fixed": f.fixed} for f in self._figures]
        scripts = "".join(f"<script>{_static(name)}</script>\n" for name in ("page.js", *self._scripts))
        links = "".join(f'<a href="#{name}">{escape(title)}</a>' for name, title in self._links)
        data = {"figures": figures, **self._data}
        return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{escape(self.title)} · {escape(self.kind)}</title>
<link rel="icon" href="data:,">
<style>{_static("page.css")}</style>
</head>
<body>
<a class="skip" href="#evidence">Skip to the evidence</a>
<header class="answer {escape(self.tone)}">
<div class="words">
<p class="kind">{escape(self.kind)} · {escape(self.title)}</p>
<h1>{escape(self.verdict)}</h1>
{_found(self.findings)}{self.lead}
{_notes(self.notes)}</div>
<div class="picture">{self._picture}</div>
</header>
<nav aria-label="Sections">{links}</nav>
<main id="evidence">
{"".join(self._parts)}
</main>
<footer>{self.foot}
<p class="hint">Drag in a plot to zoom, double-click to go back. Keyboard: Tab to a plot, then + − ← → and 0.</p>
</footer>
<noscript><p class="hint">The plots need JavaScript; the sentences and tables do not.</p></noscript>
<script type="application/json" id="data">{script_text(data)}</script>
<script>{_plotly()}</script>
{scripts}</body>
</html>
"""


def text(value: object) -> str:
    """HTML text of anything a user may have named."""
    return escape(str(value))


def packed(values: ArrayLike) -> dict[str, str]:
    """Numbers as plotly's typed arrays: 32-bit floats in base64, a third of their size in digits."""
    raw = np.ascontiguousarray(values, dtype="<f4").tobytes()
    return {"dtype": "f4", "bdata": base64.b64encode(raw).decode("ascii")}


def table(
    header: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "", words: int = 1, last_words: bool = False
) -> str:
    """An HTML table; cells are HTML. The first ``words`` columns are set left, with ``last_words`` the last one too."""
    left = {*range(words), *([len(header) - 1] if last_words else [])}
    align = [' class="word"' if i in left else "" for i in range(len(header))]
    head = "".join(f'<th scope="col"{a}>{cell}</th>' for a, cell in zip(align, header, strict=True))
    body = "".join(
        "<tr>" + "".join(_cell(i, a, cell) for i, (a, cell) in enumerate(zip(align, row, strict=True))) + "</tr>"
        for row in rows
    )
    about = f"<caption>{caption}</caption>" if caption else ""
    inside = f"<table>{about}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f'<div class="scroll" tabindex="0" role="region" aria-label="table">{inside}</div>'


def folded(summary: str, html: str) -> str:
    """HTML that opens on demand (and in print)."""
    return f"<details><summary>{escape(summary)}</summary>{html}</details>"


#: Findings in the head of a page before the rest is folded away.
SAID = 3
_STYLES = {IMPOSSIBLE: "bad-word", SET_ASIDE: "warn-word", WARNING: "warn-word", NOTE: "soft"}


def severity_word(finding: Finding) -> str:
    """A finding's severity as HTML."""
    return f'<span class="{_STYLES[finding.severity]}">{CALLED[finding.severity].capitalize()}</span>'


def findings_list(findings: Sequence[Finding]) -> str:
    """HTML list of findings, in the order given."""
    return "<ul>" + "".join(f"<li>{severity_word(f)}: {text(f.line)}.</li>" for f in findings) + "</ul>"


def _found(findings: Sequence[Finding]) -> str:
    """Findings in the head of a page, the first few in sight."""
    if not findings:
        return ""
    rest = findings[SAID:]
    more = folded(f"{len(rest)} more about the data", findings_list(rest)) if rest else ""
    return f'<div class="findings">{findings_list(findings[:SAID])}{more}</div>\n'


def _notes(notes: Sequence[str]) -> str:
    """Notes in the head of a page, folded away where there are more than three."""
    if not notes:
        return ""
    lines = "<ul>" + "".join(f"<li>{text(note)}</li>" for note in notes) + "</ul>"
    summary = f"The data as read: {len(notes)} remarks"
    return f'<div class="notes">{folded(summary, lines) if len(notes) > 3 else f"<p>The data as read:</p>{lines}"}</div>\n'


def _cell(column: int, align: str, cell: str) -> str:
    return f'<th scope="row"{align}>{cell}</th>' if column == 0 else f"<td{align}>{cell}</td>"


def _static(name: str) -> str:
    return resources.files(__package__).joinpath("static", name).read_text(encoding="utf-8")


def _plotly() -> str:
    """plotly.js as the Python package ships it, with a ``</script`` inside a string kept from ending the element."""
    script = resources.files("plotly").joinpath("package_data", "plotly.min.js").read_text(encoding="utf-8")
    return script.replace("</script", "<\\/script")
