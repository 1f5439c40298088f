# SPDX-License-Identifier: Apache-2.0
"""Messages that wait in a queue, and messages as plain data. `rosidl_runtime_py` does the latter too, but it is not
among the wheels."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module

import numpy as np
from rclpy.subscription import Subscription


def waiting(subscription: Subscription) -> Iterator[tuple[object, dict[str, int]]]:
    """Take what lies in a subscription's queue, one after another, each with what the middleware says of it.

    The executor would hand over one message in a turn, at five times the cost. There is no end while messages come
    faster than they are used.
    """
    while (taken := subscription.handle.take_message(subscription.msg_type, subscription.raw)) is not None:
        yield taken


def message_class(type_name: str) -> type:
    """`geometry_msgs/msg/PoseStamped` → its class. Raises ImportError, AttributeError or ValueError."""
    package, folder, name = type_name.split("/")
    return getattr(import_module(f"{package}.{folder}"), name)


def plain(message: object) -> object:
    """A message as dicts, lists and numbers, its fields in their order."""
    if hasattr(message, "get_fields_and_field_types"):
        return {name: plain(getattr(message, name)) for name in message.get_fields_and_field_types()}
    if isinstance(message, (bytes, bytearray)):
        return int.from_bytes(message, "little") if len(message) == 1 else list(message)
    if isinstance(message, np.ndarray) or hasattr(message, "typecode"):
        return message.tolist()
    if isinstance(message, (list, tuple)):
        return [plain(one) for one in message]
    return message


def flat(data: object, name: str = "") -> Iterator[tuple[str, object]]:
    """Names and values of all numbers and strings: ``pose.position.x``, ``covariance[3]``."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from flat(value, f"{name}.{key}" if name else key)
    elif isinstance(data, list):
        for number, value in enumerate(data):
            yield from flat(value, f"{name}[{number}]")
    else:
        yield name, data
