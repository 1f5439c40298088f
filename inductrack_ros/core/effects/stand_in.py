# SPDX-License-Identifier: Apache-2.0
"""Stand-ins: a smooth force, or a smooth change of the thrust, where the physics is not known yet. It depends on one
variable, or is a product: a smooth function of one times a power of another.

A diagnosis that finds a misfit no effect explains puts one of these in the model, so that prediction improves while
the physics is sought. They explain nothing, and they are not in the ranking.
"""

import numpy as np

from ..cache import compiled_once
from ..state import COORDINATES
from . import Parameter, effect

#: What a stand-in, named ``stand_in_<one of these>``, acts on: it adds to a coordinate's force or changes the thrust by
#: a share.
ACTS_ON = (*COORDINATES, "thrust")
#: What a stand-in may depend on, in the order of its ``variable``.
VARIABLES = (
    "surge", "sway", "heave", "roll", "surge_rate", "sway_rate", "heave_rate", "roll_rate", "time", "drive",
)  # fmt: skip
TABLE = 192


def picked(variable, surge, sway, heave, roll, surge_rate, sway_rate, heave_rate, roll_rate, time, drive):
    """The variable of this number."""
    u = surge
    if variable == 1.0:
        u = sway
    elif variable == 2.0:
        u = heave
    elif variable == 3.0:
        u = roll
    elif variable == 4.0:
        u = surge_rate
    elif variable == 5.0:
        u = sway_rate
    elif variable == 6.0:
        u = heave_rate
    elif variable == 7.0:
        u = roll_rate
    elif variable == 8.0:
        u = time
    elif variable == 9.0:
        u = drive
    return u


def curve(
    variable,
    surge,
    sway,
    heave,
    roll,
    surge_rate,
    sway_rate,
    heave_rate,
    roll_rate,
    time,
    drive,
    times,
    power,
    scale,
    start,
    step,
    knots,
    values,
):
    """(w/scale)^power Σ values_j B((u − start)/step − j) with the cubic B-spline B, held constant beyond the ends; u is
    the ``variable``, w the other one that it is ``times``."""
    u = picked(variable, surge, sway, heave, roll, surge_rate, sway_rate, heave_rate, roll_rate, time, drive)
    factor = 1.0
    if power != 0.0:
        w = picked(times, surge, sway, heave, roll, surge_rate, sway_rate, heave_rate, roll_rate, time, drive) / scale
        factor = w if power == 1.0 else w**power
    last = knots - 1.0
    u = min(max((u - start) / step, 0.0), last)
    first = int(u)
    total = 0.0
    for j in range(max(first - 1, 0), min(first + 2, int(last)) + 1):
        d = abs(u - j)
        if d < 1.0:
            total += values[j] * (2.0 / 3.0 - d * d + 0.5 * d * d * d)
        elif d < 2.0:
            total += values[j] * (2.0 - d) ** 3 / 6.0
    return factor * total


@compiled_once
def basis(values, start, step, count):
    """The curve's basis functions at ``values`` (n,), as (n, count); none where a value is not a number."""
    out = np.zeros((values.size, count))
    for k in range(values.size):
        if np.isnan(values[k]):
            continue
        u = min(max((values[k] - start) / step, 0.0), count - 1.0)
        first = int(u)
        for j in range(max(first - 1, 0), min(first + 2, count - 1) + 1):
            d = abs(u - j)
            out[k, j] = 2.0 / 3.0 - d * d + 0.5 * d * d * d if d < 1.0 else max(2.0 - d, 0.0) ** 3 / 6.0
    return out


def over(low, high, intervals):
    """Start, step and count of a table whose curve is any cubic spline from ``low`` to ``high``: the splines about both
    ends belong to it too."""
    step = (high - low) / intervals
    return low - step, step, intervals + 3


def covered(start, step, count):
    """From where to where a table's curve is any cubic spline."""
    return start + step, start + (count - 2) * step


def parameters(variable, start, step):
    """A stand-in's parameters but its table: over a variable by name, from ``start`` in steps of ``step``."""
    return {"variable": float(VARIABLES.index(variable)), "start": start, "step": step}


def entries(values, histories, count):
    """What the entries of a stand-in's table with these parameter ``values`` give along histories (n,) of all
    variables, (n, count)."""
    u = np.ascontiguousarray(histories[VARIABLES[int(values["variable"])]])
    found = basis(u, values["start"], values["step"], count)
    power = values.get("power", 0.0)
    if not power:
        return found
    w = histories[VARIABLES[int(values["times"])]] / values["scale"]
    return found * (w**power)[:, None]


def _parameters(unit, typical):
    return {
        "variable": Parameter(
            0.0,
            "",
            0.0,
            len(VARIABLES) - 1.0,
            "what it depends on: 0 " + ", ".join(f"{i} {v}" for i, v in enumerate(VARIABLES))[2:],
        ),
        "times": Parameter(0.0, "", 0.0, len(VARIABLES) - 1.0, "what it is multiplied by, as variable"),
        "power": Parameter(0.0, "", 0.0, 8.0, "power of what it is multiplied by (a whole number); 0 for none"),
        "scale": Parameter(1.0, "", 1e-12, 1e9, "what that is divided by first"),
        "start": Parameter(0.0, "", -1e9, 1e9, "value of the variable at the first entry of the table"),
        "step": Parameter(1.0, "", 1e-12, 1e9, "spacing of the table"),
        "knots": Parameter(1.0, "", 1.0, float(TABLE), "entries of the table in use"),
        "values": Parameter(0.0, unit, -1e9, 1e9, "coefficients of the cubic B-splines", typical=typical, count=TABLE),
    }


@effect(adds="force_surge", parameters=_parameters("N", 1.0), screened=False)
def stand_in_surge(
    surge,
    sway,
    heave,
    roll,
    surge_rate,
    sway_rate,
    heave_rate,
    roll_rate,
    time,
    drive_current,
    variable,
    times,
    power,
    scale,
    start,
    step,
    knots,
    values,
):
    """A smooth force in surge that stands in for unknown physics."""
    return curve(
        variable, surge, sway, heave, roll, surge_rate, sway_rate, heave_rate, roll_rate, time, drive_current, times,
        power, scale, start, step, knots, values,
    )  # fmt: skip


@effect(adds="force_sway", parameters=_parameters("N", 1.0), screened=False)
def stand_in_sway(
    surge,
    sway,
    heave,
    roll,
    surge_rate,
    sway_rate,
    heave_rate,
    roll_rate,
    time,
    drive_current,
    variable,
    times,
    power,
    scale,
    start,
    step,
    knots,
    values,
):
    """A smooth force in sway that stands in for unknown physics."""
    return curve(
        variable, surge, sway, heave, roll, surge_rate, sway_rate, heave_rate, roll_rate, time, drive_current, times,
        power, scale, start, step, knots, values,
    )  # fmt: skip


@effect(adds="force_heave", parameters=_parameters("N", 1.0), screened=False)
def stand_in_heave(
    surge,
    sway,
    heave,
    roll,
    surge_rate,
    sway_rate,
    heave_rate,
    roll_rate,
    time,
    drive_current,
    variable,
    times,
    power,
    scale,
    start,
    step,
    knots,
    values,
):
    """A smooth force in heave that stands in for unknown physics."""
    return curve(
        variable, surge, sway, heave, roll, surge_rate, sway_rate, heave_rate, roll_rate, time, drive_current, times,
        power, scale, start, step, knots, values,
    )  # fmt: skip


@effect(adds="moment_roll", parameters=_parameters("N·m", 0.05), screened=False)
def stand_in_roll(
    surge,
    sway,
    heave,
    roll,
    surge_rate,
    sway_rate,
    heave_rate,
    roll_rate,
    time,
    drive_current,
    variable,
    times,
    power,
    scale,
    start,
    step,
    knots,
    values,
):
    """A smooth moment in roll that stands in for unknown physics."""
    return curve(
        variable, surge, sway, heave, roll, surge_rate, sway_rate, heave_rate, roll_rate, time, drive_current, times,
        power, scale, start, step, knots, values,
    )  # fmt: skip


@effect(changes="thrust", parameters=_parameters("", 0.01), screened=False)
def stand_in_thrust(
    thrust,
    surge,
    sway,
    heave,
    roll,
    surge_rate,
    sway_rate,
    heave_rate,
    roll_rate,
    time,
    drive_current,
    variable,
    times,
    power,
    scale,
    start,
    step,
    knots,
    values,
):
    """A smooth share of the thrust, more or less, that stands in for unknown physics."""
    return thrust * (
        1.0
        + curve(
            variable,
            surge,
            sway,
            heave,
            roll,
            surge_rate,
            sway_rate,
            heave_rate,
            roll_rate,
            time,
            drive_current,
            times,
            power,
            scale,
            start,
            step,
            knots,
            values,
        )
    )
