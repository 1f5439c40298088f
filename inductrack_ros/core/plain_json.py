# SPDX-License-Identifier: Apache-2.0
"""JSON as every program reads it: numpy's numbers as numbers, null for NaN and infinity, which JSON has no word for."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np


def plain(data: Any) -> Any:
    """The same as dicts, lists, strings and finite numbers, None for numbers that are not finite."""
    if isinstance(data, dict):
        return {str(k): plain(v) for k, v in data.items()}
    if isinstance(data, (list, tuple)):
        return [plain(v) for v in data]
    if isinstance(data, np.ndarray):
        return plain(data.tolist())
    if isinstance(data, np.generic):
        return plain(data.item())
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data


def file_text(data: Any) -> str:
    """The text of a JSON file, indented, with a newline at its end."""
    return json.dumps(plain(data), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def attribute_text(data: Any) -> str:
    """JSON in one line of ASCII, for an attribute of a file that has no mappings."""
    return json.dumps(plain(data), allow_nan=False)


def script_text(data: Any) -> str:
    """JSON that can stand inside a script element of HTML, whatever it holds."""
    return json.dumps(plain(data), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
