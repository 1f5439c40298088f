# SPDX-License-Identifier: Apache-2.0
"""Samples in the order of their stamps: what loggers and middleware do to that order, and what no order can mend."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from .measurement import Array

#: Samples filed this much (s) out of order are sorted; a clock that goes back further was set back, or there are two
#: runs.
OUT_OF_ORDER = 0.5
#: What a clock is set back by at the end of summer time (s), but for so many usual steps.
HOUR, WENT_ON = 3600.0, 5.0
#: Stamps of 0 this long (s) before all others were given before the clock ran.
BEFORE_THE_CLOCK = 10.0
#: Values that go this many times as far, to and fro, in the order of their stamps as in that of their filing: the clock
#: was set back, and nothing was filed late.
TORN = 3.0


@dataclass(frozen=True)
class Place:
    """How samples are named: ``where`` is the file and topic, ``name(i)`` one of them, say "row 7", ``kind`` what they
    are, say "row"."""

    where: str
    name: Callable[[int], str]
    kind: str
    remedy: str
    about: str = ""

    def counted(self, count: int) -> str:
        return f"{count} {self.kind}{'' if count == 1 else 's'}{self.about}"


@np.errstate(over="ignore")  # of stamps that are none
def in_order(
    stamps: Array | NDArray[np.int64], columns: Sequence[Array], place: Place
) -> tuple[NDArray[np.intp] | None, list[str]]:
    """Indices that put samples in the order of their stamps, each once, or None where they stand so; and what is to be
    said of it.

    stamps: (n,) s, or whole ns; columns: (n,) each. Left out are stamps of 0 before the clock ran, and exact repeats.
    Raises InputError for a clock that goes back and for two different samples at one time.
    """
    second = 1_000_000_000 if stamps.dtype.kind == "i" else 1.0
    if len(stamps) < 2 or (np.diff(stamps) > 0).all() and (stamps[0] != 0 or not _before_the_clock(stamps[1:], second)):
        return None, []
    notes: list[str] = []
    index = np.arange(len(stamps))
    zero = stamps == 0
    if zero.any() and _before_the_clock(stamps[~zero], second):
        index = index[~zero]
        notes.append(f"{place.counted(int(zero.sum()))} stamped 0 left out: {_when(np.flatnonzero(zero), place)}")
    if len(index) > 2 and (np.diff(stamps[index]) < 0).all():
        index = index[::-1]
        notes.append(f"{place.counted(len(index))} filed last first turned round")
    index, again = _once(stamps, columns, index)
    if again:
        notes.append(f"{place.counted(again)} that repeat{'s' if again == 1 else ''} another exactly left out")
    late = np.maximum.accumulate(stamps[index]) - stamps[index]
    if late.max() > OUT_OF_ORDER * second:
        i = int(np.argmax(late > OUT_OF_ORDER * second))
        back, name = late[i] / second, place.name(int(index[i]))
        remedy = place.remedy
        usual = float(np.median(np.abs(np.diff(stamps[index])))) / second
        if 0 <= HOUR - back <= WENT_ON * usual:
            remedy = "did summer time end? write the times in UTC or with their zone, or add an hour to the later ones"
        raise InputError(f"{place.where}: {name} is stamped {back:.6g} s earlier than one before it; {remedy}")
    if late.any():
        filed, index = index, index[np.argsort(stamps[index], kind="stable")]
        if _torn(columns, filed, index):
            i = int(np.argmax(late > 0))
            back, name = late[i] / second, place.name(int(filed[i]))
            raise InputError(
                f"{place.where}: the clock was set back by {back:.3g} s at {name}: the samples fit each other as they"
                f" are filed, not as they are stamped; {place.remedy}"
            )
        notes.append(f"{place.counted(int((late > 0).sum()))} filed out of order sorted by their stamps")
    same = np.flatnonzero(np.diff(stamps[index]) == 0)
    if len(same):
        earlier, later = place.name(int(index[same[0]])), place.name(int(index[same[0] + 1]))
        more = f" ({len(same) - 1} more such)" if len(same) > 1 else ""
        remedy = _why_the_same(stamps[index], len(same), second, place) or place.remedy
        raise InputError(f"{place.where}: {later} repeats the stamp of {earlier} with other values{more}; {remedy}")
    return index, notes


def _when(zero: NDArray[np.intp], place: Place) -> str:
    """What is said of stamps of 0, by where the samples (indices, as filed) stand."""
    if zero[-1] == len(zero) - 1:
        return "the clock did not run yet"
    first, last = place.name(int(zero[0])), place.name(int(zero[-1]))
    span = f"{first} to {last}" if zero[-1] - zero[0] == len(zero) - 1 else f"{first} the first, {last} the last"
    return f"the clock did not run there ({span})"


def _why_the_same(stamps: Array | NDArray[np.int64], same: int, second: float, place: Place) -> str:
    """The cause and the remedy where many samples share their stamps (n,); ``same``: how many do with one before."""
    if 2 * same < len(stamps):
        return ""
    if same == len(stamps) - 1:
        return "all have one and the same (too few digits?); give each its own time"
    if not (stamps % second).any():
        return "all are whole seconds: write the fractions too (of a header stamp, nanosec)"
    each = len(stamps) / (len(stamps) - same)
    cause = "the stamp of a block?" if stamps.dtype.kind == "i" else "too few digits?"
    return f"about {each:.0f} {place.kind}s share each stamp ({cause}); give each its own time"


def _once(
    stamps: Array | NDArray[np.int64], columns: Sequence[Array], index: NDArray[np.intp]
) -> tuple[NDArray[np.intp], int]:
    """The samples ``index`` without those that repeat an earlier filed one in stamp and values, also all of them again
    as a player in a loop files them; and how many these are."""
    filed = index[np.argsort(stamps[index], kind="stable")]
    again = np.diff(stamps[filed]) == 0
    if not again.any():
        return index, 0
    earlier, later = filed[:-1][again], filed[1:][again]
    equal = np.ones(len(later), bool)
    for column in columns:
        a, b = column[earlier], column[later]
        equal &= (a == b) | (np.isnan(a) & np.isnan(b))
    return index[~np.isin(index, later[equal])], int(equal.sum())


def _torn(columns: Sequence[Array], filed: NDArray[np.intp], in_time: NDArray[np.intp]) -> bool:
    """Whether sorting tore some column to pieces, so that its clock was set back and nothing filed late."""
    moved = filed != in_time
    beside = moved[:-1] | moved[1:]
    for column in columns:
        a, b = (np.abs(np.diff(column[order])[beside]) for order in (filed, in_time))
        with np.errstate(over="ignore", invalid="ignore"):
            if np.nansum(b) > TORN * np.nansum(a) > 0.0:
                return True
    return False


def _before_the_clock(others: Array | NDArray[np.int64], second: float) -> bool:
    """Whether a stamp of 0 lies so far before the ``others`` that it is none: further than their own steps make
    plausible."""
    if not len(others) or others.min() <= BEFORE_THE_CLOCK * second:
        return False
    return len(others) == 1 or others.min() > 100.0 * np.median(np.abs(np.diff(others)))
