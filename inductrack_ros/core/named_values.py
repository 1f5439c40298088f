# SPDX-License-Identifier: Apache-2.0
"""``NAME=VALUE,…`` as users write it on a command line or in a parameter."""

from __future__ import annotations

from .errors import InputError


def named_values(given: str, where: str, example: str) -> dict[str, float]:
    """``surge_rate=15.5,sway=0.004`` as a mapping; who uses it checks the names.

    Raises `InputError`, which says ``where`` and gives the ``example``.
    """
    values: dict[str, float] = {}
    for entry in filter(None, (part.strip() for part in given.split(","))):
        name, number = assigned(entry)
        if name and name in values:
            raise InputError(f"{where}: '{name}' is given twice")
        try:
            if not name:
                raise ValueError
            values[name] = float(number)
        except ValueError:
            raise InputError(f"{where}: '{entry}' is not NAME=NUMBER, e.g. {example}") from None
    return values


def assigned(text: str) -> tuple[str, str]:
    """``NAME=VALUE`` as its two parts; both empty where one of them, or the sign, is missing."""
    name, equals, value = (part.strip() for part in text.partition("="))
    return (name, value) if name and equals and value else ("", "")
