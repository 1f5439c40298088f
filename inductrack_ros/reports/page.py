# SPDX-License-Identifier: Apache-2.0
"""The page all reports share: a first screen that answers the question, the evidence under it, one file, offline.

A figure is plain plotly JSON whose colours are names such as ``@measured``. The page fills in the colours of the
reader's theme, and does so again when the theme changes or the page is printed.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import ArrayLike

from ..checks import CALLED, IMPOSSIBLE, NOTE, SET_ASIDE, WARNING, Finding
from ..core.plain_json import script_text

_TEMPLATES = Environment(
    loader=PackageLoader("inductrack_ros.reports"),
    autoescape=True,
    undefined=StrictUndefined,
    keep_trailing_newline=True,
)
#: Pieces of HTML by name, see `templates/parts.html`.
parts: Any = _TEMPLATES.get_template("parts.html").module


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
    _sections: list[dict[str, str]] = field(default_factory=list)
    _data: dict[str, Any] = field(default_factory=dict)
    _scripts: list[str] = field(default_factory=list)
    _picture: str = ""

    def figure(self, figure: Figure, caption: str = "") -> Markup:
        """Register a figure and return the HTML that stands for it."""
        number = len(self._figures)
        self._figures.append(figure)
        return parts.figure(f"plot-{number}", number, figure.label, figure.height, caption)

    def picture(self, html: Markup) -> None:
        """What stands beside the verdict on the first screen."""
        self._picture = html

    def section(self, title: str, body: str, name: str = "") -> None:
        """Add a section of evidence; in ``body`` only `Markup` is HTML."""
        name = name or "".join(c if c.isalnum() else "-" for c in title.lower()).strip("-")
        self._sections.append({"name": name, "title": title, "body": body})

    def script(self, file: str, name: str, data: Any) -> None:
        """Add a script of `static/`, which finds ``data`` under ``name``."""
        if file not in self._scripts:
            self._scripts.append(file)
        self._data[name] = data

    def render(self) -> str:
        """The whole page."""
        figures = [{"data": f.data, "layout": f.layout, "fixed": f.fixed} for f in self._figures]
        said, rest = self.findings[:SAID], self.findings[SAID:]
        return _TEMPLATES.get_template("page.html").render(
            page=self,
            picture=self._picture,
            sections=self._sections,
            findings=parts.findings([finding_words(f) for f in said], [finding_words(f) for f in rest]),
            notes=parts.notes(self.notes),
            style=Markup(_static("page.css")),
            data=Markup(script_text({"figures": figures, **self._data})),
            plotly=Markup(_plotly()),
            scripts=[Markup(_static(name)) for name in ("page.js", *self._scripts)],
        )


def packed(values: ArrayLike) -> dict[str, str]:
    """Numbers as plotly's typed arrays: 32-bit floats in base64, a third of their size in digits; a table is told row
    by row."""
    raw = np.ascontiguousarray(values, dtype="<f4")
    shape = {"shape": ", ".join(str(n) for n in raw.shape)} if raw.ndim > 1 else {}
    return {"dtype": "f4", "bdata": base64.b64encode(raw.tobytes()).decode("ascii"), **shape}


def markup(html: str, *values: object) -> Markup:
    """HTML with ``{}`` where values go; they are escaped unless they are Markup themselves."""
    return Markup(html).format(*values)


def joined(pieces: Iterable[object], between: str = "") -> Markup:
    """Pieces one after another; what is not Markup is escaped."""
    return Markup(between).join(pieces)


def bullets(points: Sequence[object]) -> Markup:
    """An HTML list."""
    return parts.bullets(points)


def table(
    header: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "", words: int = 1, last_words: bool = False
) -> Markup:
    """An HTML table. The first ``words`` columns are set left, with ``last_words`` the last one too."""
    left = {*range(words), *([len(header) - 1] if last_words else [])}
    return parts.table(header, [{"cells": row} for row in rows], caption, left)


def folded(summary: str, body: str) -> Markup:
    """HTML that opens on demand (and in print)."""
    return parts.folded(summary, body)


#: Findings in the head of a page before the rest is folded away.
SAID = 3
_STYLES = {IMPOSSIBLE: "bad-word", SET_ASIDE: "warn-word", WARNING: "warn-word", NOTE: "soft"}


def severity_word(finding: Finding) -> Markup:
    """A finding's severity as HTML."""
    return markup('<span class="{}">{}</span>', _STYLES[finding.severity], CALLED[finding.severity].capitalize())


def finding_words(finding: Finding) -> Markup:
    """A finding in one line, its severity first."""
    return markup("{}: {}", severity_word(finding), finding.line if finding.line.endswith("?") else f"{finding.line}.")


def findings_list(findings: Sequence[Finding]) -> Markup:
    """HTML list of findings, in the order given."""
    return bullets([finding_words(f) for f in findings])


def _static(name: str) -> str:
    return resources.files(__package__).joinpath("static", name).read_text(encoding="utf-8")


def _plotly() -> str:
    """plotly.js, with a ``</script`` inside a string kept from ending the element."""
    from plotly.offline import get_plotlyjs  # half a second that only a page that is written needs

    return get_plotlyjs().replace("</script", "<\\/script")
