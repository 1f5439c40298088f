# SPDX-License-Identifier: Apache-2.0
"""Words for any terminal: where its encoding has no η or ±, one that is read as well stands there."""

from __future__ import annotations

import codecs
import os
import sys

_PLAIN = {
    "η": "eta",
    "γ": "gamma",
    "σ": "sigma",
    "χ": "chi",
    "λ": "lambda",
    "δ": "delta",
    "Δ": "Delta",
    "Σ": "sum",
    "Ω": "Ohm",
    "π": "pi",
    "ω": "omega",
    "µ": "u",
    "μ": "u",
    "°": "deg",
    "·": "*",
    "×": "x",
    "±": "+-",
    "−": "-",
    "–": "-",
    "—": "-",
    "…": "...",
    "√": "sqrt ",
    "∞": "inf",
    "≤": "<=",
    "≥": ">=",
    "≈": "~",
    "→": "->",
    "←": "<-",
    "“": '"',
    "”": '"',
    "‘": "'",
    "’": "'",
    "\u202f": " ",
    "\u00a0": " ",
    "²": "^2",
    "³": "^3",
    "⁻": "^-",
    **{c: str(i) for i, c in enumerate("⁰¹  ⁴⁵⁶⁷⁸⁹") if c != " "},
    "ä": "ae",
    "ö": "oe",
    "ü": "ue",
    "ß": "ss",
    "█": "#",
    "▁": "_",
    "│": "|",
    "─": "-",
    "•": "*",
}


def _plain(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(_PLAIN.get(c, "?") for c in error.object[error.start : error.end]), error.end


codecs.register_error("inductrack.plain", _plain)


def speak_to_any_terminal() -> None:
    """From now on what is printed never fails for its letters, whatever the terminal's encoding and the names of files,
    nor for a stream that was closed before the program began."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # `>&-`
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # not what a test or a notebook puts there
            stream.reconfigure(errors="inductrack.plain")
