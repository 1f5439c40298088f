# SPDX-License-Identifier: Apache-2.0
"""Messages of sensors that declare themselves (`core.channels`): a number to a field, in the messages of `rosbags`."""

from __future__ import annotations

from functools import lru_cache, reduce
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from ..core.errors import InputError
from ..core.state import CHANNEL, INSTRUMENTS

_HEADER = "std_msgs/msg/Header"


@lru_cache(maxsize=1)
def _store() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)


def fields_of(sensor: str) -> tuple[str, ...]:
    """The field of each of a sensor's channels. Raises `InputError` where its message has no header or no such
    number."""
    names, msgtype = INSTRUMENTS[sensor].channels, INSTRUMENTS[sensor].message
    known = _store().fielddefs
    if msgtype not in known or ("header", _HEADER) not in [(n, of) for n, (_, of) in known[msgtype][1]]:
        problem = "is not known" if msgtype not in known else "has no header"
        raise InputError(f"{CHANNEL[names[0]].place}: {msgtype} {problem}; say a geometry_msgs/msg/PointStamped")
    blank = blank_message(msgtype)
    for name in names:
        try:
            float(read_field(blank, CHANNEL[name].field))
        except (AttributeError, TypeError, ValueError):
            fields = ", ".join(field for field, _ in known[msgtype][1])
            raise InputError(
                f"{CHANNEL[name].place}: there is no number {CHANNEL[name].field} in {msgtype}, which has {fields}"
            ) from None
    return tuple(CHANNEL[name].field for name in names)


def write_field(message: Any, field: str, value: float) -> None:
    """Put a number into a message's field."""
    *parents, last = field.split(".")
    setattr(reduce(getattr, parents, message), last, float(value))


def read_field(message: Any, field: str) -> Any:
    """What stands in a message's field, ``point.x`` say."""
    return reduce(getattr, field.split("."), message)


def blank_message(msgtype: str) -> Any:
    """A message of this type in which every number is 0 and every list empty."""
    store = _store()
    return store.types[msgtype](*(_blank(definition) for _, definition in store.fielddefs[msgtype][1]))


def _blank(definition: tuple) -> Any:
    kind, of = definition
    name = kind.name
    if name == "NAME":
        return blank_message(of)
    if name == "BASE":
        return {"string": "", "wstring": "", "bool": False}.get(of[0], 0.0 if of[0].startswith("float") else 0)
    inner, count = of
    if inner[0].name == "BASE" and inner[1][0] not in ("string", "wstring"):
        return np.zeros(count if name == "ARRAY" else 0, inner[1][0] if inner[1][0] != "octet" else "uint8")
    return [_blank(inner) for _ in range(count if name == "ARRAY" else 0)]
