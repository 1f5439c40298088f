# SPDX-License-Identifier: Apache-2.0
"""What is known of a bag's file that is read record after record, for it is cut off or damaged."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

#: Stretches that are named one by one.
NAMED = 3


@dataclass(frozen=True)
class Channel:
    """Topic of a channel, its message type (with the encoding of its messages, where that is not ROS 2's), and what its
    publisher offered (YAML, may be empty)."""

    topic: str
    msgtype: str
    offered_qos: str


@dataclass(frozen=True)
class Loss:
    """A damaged stretch of a file, between the log times (ns) of the whole messages beside it; None at an end of the
    file. Where it is only ``changed`` all messages are there, but a check sum says that some byte is another."""

    after: int | None
    before: int | None
    changed: bool = False


#: A whole message (channel, log time in ns, bytes), or a stretch of the file in which some are lost.
Found = tuple[Channel, int, bytes] | Loss


def in_words(losses: Iterable[Loss], begin: int) -> str:
    """Where a file is damaged, in seconds from the log time ``begin`` (ns)."""
    stretches = [(_between(loss, begin), loss.changed) for loss in losses]
    lost = [where for where, changed in stretches if not changed]
    doubted = [where for where, changed in stretches if changed]
    said = f"is damaged {_listed(lost)}" if lost else "is damaged"
    if doubted:
        said += f", and messages {_listed(doubted)} may be changed, for a check sum does not fit"
    return said


def _between(loss: Loss, begin: int) -> str:
    """``from 1.2 to 1.36 s``."""
    after, before = ("" if t is None else f"{(t - begin) / 1e9:.4g}" for t in (loss.after, loss.before))
    if after and before:
        return f"from {after} to {before} s"
    return f"from {after} s to its end" if after else f"up to {before} s" if before else "from end to end"


def _listed(stretches: list[str]) -> str:
    more = len(stretches) - NAMED
    named = ", ".join(stretches[:NAMED])
    return f"{named} and in {more} more places" if more > 0 else named
