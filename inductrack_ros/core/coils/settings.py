# SPDX-License-Identifier: Apache-2.0
"""What a track of single coils is made of: its options, declared once, and their check."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..options import COIL_OPTIONS, NO_COIL, SIM

#: Angles at which the inductance of a row of coils must be positive.
_ANGLES = np.linspace(0.0, np.pi, 721)


@dataclass(frozen=True)
class CoilTrack:
    """Checked options of a track of single coils, SI; coil n (from 0) stands at n × ``pitch``.

    ``mutual_inductance`` holds M of the first neighbour, the second, …; ``failed`` and ``damaged`` are coil numbers,
    ``factors`` the resistance of each damaged coil over that of a whole one.
    """

    pitch: float
    spacing: float
    wavelengths: float
    mutual_inductance: tuple[float, ...]
    failed: tuple[int, ...]
    damaged: tuple[int, ...]
    factors: tuple[float, ...]


def coil_track(options: Mapping[str, object], parameters: Mapping[str, float], where: str = "") -> CoilTrack:
    """The track that ``options`` (names of `COIL_OPTIONS` and ``track_length``, defaults where absent) describe under
    the model's ``parameters``. Raises `InputError`."""
    place = f"{where}: " if where else ""
    given: dict[str, Any] = {
        name: one.check(name, options.get(name, one.default), where) for name, one in COIL_OPTIONS.items()
    }
    declared = SIM["track_length"]
    length: Any = declared.check("track_length", options.get("track_length", declared.default), where)
    pitch = given["coil_pitch"] or parameters["wavelength"] / parameters["coils_per_wavelength"]
    failed, damaged = (
        _numbers("failed_coils", given, length, pitch, place),
        _numbers("damaged_coils", given, length, pitch, place),
    )
    if both := sorted({*failed} & {*damaged}):
        raise InputError(f"{place}coil {both[0]} is in failed_coils and in damaged_coils; leave it in one of them")
    array = given["array_wavelengths"] * parameters["wavelength"]
    if given["array_spacing"] < array - 1e-9:
        raise InputError(
            f"{place}array_spacing = {given['array_spacing']:g} m: the front and the rear set are {array:g} m long each"
            f" (array_wavelengths) and would overlap; give at least {array:g} m"
        )
    mutual = _mutual(given["mutual_inductance"], parameters["inductance"], place)
    factors = _factors(given["damage_factor"], damaged, place)
    return CoilTrack(pitch, given["array_spacing"], given["array_wavelengths"], mutual, failed, damaged, factors)


def _numbers(name: str, given: Mapping[str, Any], length: float, pitch: float, place: str) -> tuple[int, ...]:
    """The coil numbers of a list, rising, each once."""
    numbers = sorted({n for n in given[name] if n != NO_COIL})
    last = math.floor(length / pitch)
    for n in numbers:
        if not 0 <= n <= last:
            raise InputError(
                f"{place}{name}: coil {n} is off the track, whose coils are 0 to {last} (track_length {length:g} m,"
                f" one every {1e3 * pitch:g} mm)"
            )
    return tuple(numbers)


def _mutual(given: float | Sequence[float], inductance: float, place: str) -> tuple[float, ...]:
    """Mutual inductances without zeros at the end. Raises `InputError` where the coils together would store negative
    energy."""
    values = list(given) if isinstance(given, Sequence) else [given]
    while values and values[-1] == 0.0:
        values.pop()
    total = inductance + sum(2.0 * m * np.cos((j + 1) * _ANGLES) for j, m in enumerate(values))
    if np.min(total) <= 1e-3 * inductance:
        raise InputError(
            f"{place}mutual_inductance = {', '.join(f'{m:g}' for m in values)} H is too large for an inductance of"
            f" {inductance:g} H: neighbours together would store negative energy; |M| of the first must stay below half"
        )
    return tuple(values)


def _factors(given: float | Sequence[float], damaged: tuple[int, ...], place: str) -> tuple[float, ...]:
    values = tuple(given) if isinstance(given, Sequence) else (given,)
    if len(values) not in (1, len(damaged)):
        raise InputError(
            f"{place}damage_factor holds {len(values)} numbers for {len(damaged)} damaged_coils; give one for all, or"
            " one for each"
        )
    return values * len(damaged) if len(values) == 1 else values
