# SPDX-License-Identifier: Apache-2.0
"""Unknown forces as laws: closed forms that a diagnosis may know (`docs/laws.md`), forms that it does not, and products
of two variables. Written apart from the package; names and parameters are those of the page.

A law is size * form(u; a, b) * (w / scale)^power in one coordinate, u and w being state, speed or time. The size is the
force (N, N m for roll) where the form is one.
"""

import math

from numba import njit

VARIABLES = ("surge", "sway", "heave", "roll", "surge_rate", "sway_rate", "heave_rate", "roll_rate", "time")
COORDINATES = ("surge", "sway", "heave", "roll")
INSIDE = ("cubic", "quadratic", "exponential", "bump", "sine", "step", "ramp", "dead_zone", "saturation", "power",
          "eddy", "linear", "stretch", "pull_and_push", "ringing")  # fmt: skip
OUTSIDE = ("two_bumps", "sawtooth", "chirp")
FORMS = INSIDE + OUTSIDE


@njit(cache=True)
def value(form, u, a, b):
    """The form number `form` of FORMS at u. (`simulator` is compiled with it: touch that file after a change here.)"""
    x = u / b
    if form == 0:
        return x**3
    if form == 1:
        return x * abs(x)
    if form == 2:
        return math.exp(-(u - a) / b)
    if form == 3:
        return math.exp(-(((u - a) / b) ** 2))
    if form == 4:
        return math.sin(2 * math.pi * u / a + b)
    if form == 5:
        return 0.5 * (1 + math.tanh((u - a) / b))
    if form == 6:
        return max(u - a, 0.0) / b
    if form == 7:
        return (max(u - a, 0.0) - max(-u - a, 0.0)) / b
    if form == 8:
        return math.tanh(x)
    if form == 9:
        return math.copysign(abs(u / a) ** b, u)
    if form == 10:
        return 2 * x / (1 + x * x)
    if form == 11:
        return x
    if form == 12:
        return 0.5 * (math.tanh((u - a) / (0.15 * b)) - math.tanh((u - a - b) / (0.15 * b)))
    if form == 13:
        return 2.3316 * (u - a) / b * math.exp(-(((u - a) / b) ** 2))
    if form == 14:
        return math.exp(-abs(u) / a) * math.sin(2 * math.pi * u / b)
    if form == 15:
        return math.exp(-(((u - a) / b) ** 2)) - 0.7 * math.exp(-(((u - a - 3 * b) / b) ** 2))
    if form == 16:
        return 2 * (u / a - math.floor(u / a)) - 1
    return math.sin(2 * math.pi * (u / a) ** 2)


def known_parameters(form, size, a, b):
    """The parameters of a law by the page's names; none for a form outside it."""
    return {
        "cubic": lambda: {"coefficient": size / b**3},
        "quadratic": lambda: {"coefficient": size / b**2},
        "exponential": lambda: {"force": size * math.exp(a / b), "length": b},
        "bump": lambda: {"force": size, "place": a, "width": b},
        "sine": lambda: {"force": abs(size), "wavelength": a, "phase": _turned(b + (math.pi if size < 0 else 0.0))},
        "step": lambda: {"force": size, "place": a, "width": b},
        "ramp": lambda: {"slope": size / b, "threshold": a},
        "dead_zone": lambda: {"slope": size / b, "clearance": a},
        "saturation": lambda: {"force": size, "width": b},
        "power": lambda: {"coefficient": size / a**b, "power": b},
        "eddy": lambda: {"slope": 2 * size / b, "peak": b},
        "linear": lambda: {"slope": size / b},
        "stretch": lambda: {"force": size, "place": a + 0.5 * b, "width": 0.5 * b, "edge": 0.15 * b},
        "pull_and_push": lambda: {"force": size, "place": a, "width": b},
        "ringing": lambda: {"force": abs(size), "length": a, "wavelength": b, "phase": math.pi if size < 0 else 0.0},
    }.get(form, dict)()


def _turned(phase):
    """A phase within pi of none."""
    return (phase + math.pi) % (2 * math.pi) - math.pi


def _between(low, high):
    return lambda rng, reach: float(rng.uniform(low, high))


def _on_the_way(low, high):
    return lambda rng, reach: float(rng.uniform(low, high) * reach)


_A_PLACE, _WIDE = _on_the_way(0.2, 0.7), _between(0.3, 1.5)
_NOTHING, _ONE, _MM, _RATE = _between(0, 0), _between(1, 1), _between(2e-3, 2e-3), _between(0.1, 0.1)
#: (coordinate, form, variable): how its a and b are drawn, from rng and the median travel (m).
DRAWN = {
    ("sway", "cubic", "sway"): (_NOTHING, _MM),
    ("sway", "quadratic", "sway_rate"): (_NOTHING, _RATE),
    ("sway", "dead_zone", "sway"): (_between(5e-4, 1.5e-3), _between(1e-3, 1e-3)),
    ("sway", "saturation", "sway_rate"): (_NOTHING, _between(0.01, 0.05)),
    ("sway", "bump", "surge"): (_A_PLACE, _WIDE),
    ("sway", "sine", "surge"): (_between(1.5, 6), _between(-3, 3)),
    ("sway", "ramp", "surge_rate"): (_between(18, 24), _between(5, 5)),
    ("heave", "bump", "surge"): (_A_PLACE, _WIDE),
    ("heave", "sine", "surge"): (_between(1.5, 6), _between(-3, 3)),
    ("heave", "exponential", "heave"): (_between(-5e-3, -5e-3), _between(8e-4, 2.5e-3)),
    ("heave", "quadratic", "heave_rate"): (_NOTHING, _RATE),
    ("heave", "power", "heave_rate"): (_RATE, _between(0.5, 0.8)),
    ("heave", "eddy", "heave_rate"): (_NOTHING, _between(0.02, 0.08)),
    ("heave", "step", "time"): (_between(0.25, 0.5), _between(0.01, 0.05)),
    ("surge", "bump", "surge"): (_A_PLACE, _WIDE),
    ("surge", "step", "surge"): (_A_PLACE, _between(0.2, 0.8)),
    ("surge", "ramp", "surge_rate"): (_between(18, 24), _between(5, 5)),
    ("surge", "step", "time"): (_between(0.25, 0.5), _between(0.01, 0.05)),
    ("roll", "cubic", "roll"): (_NOTHING, _between(4e-3, 4e-3)),
    ("roll", "bump", "surge"): (_A_PLACE, _WIDE),
    ("roll", "saturation", "roll_rate"): (_NOTHING, _between(0.02, 0.1)),
    **{(c, f, "surge"): (_A_PLACE, _WIDE) for c in COORDINATES for f in ("stretch", "pull_and_push", "two_bumps")},
    **{(c, "sawtooth", "surge"): (_between(3, 8), _ONE) for c in COORDINATES},
    **{(c, "chirp", "surge"): (_between(6, 12), _ONE) for c in COORDINATES},
    ("sway", "ringing", "time"): (_between(0.2, 0.5), _between(0.1, 0.4)),
    ("heave", "ringing", "time"): (_between(0.2, 0.5), _between(0.1, 0.4)),
}
#: Products of two: the second variable, its scale and its power.
PRODUCTS = {
    ("roll", "linear", "roll"): ("surge_rate", 20.0, 2.0),
    ("sway", "linear", "sway_rate"): ("surge_rate", 20.0, 1.0),
    ("heave", "linear", "heave_rate"): ("surge_rate", 20.0, 1.0),
    ("sway", "bump", "surge"): ("sway", 2e-3, 1.0),
    ("heave", "exponential", "heave"): ("surge_rate", 20.0, 2.0),
    ("roll", "bump", "surge"): ("sway", 2e-3, 1.0),
}
SORTS = {"inside": 0.5, "outside": 0.25, "two": 0.25}


def _table():
    """name -> entry as in `hidden_effects`, with coordinate, variables and sort."""
    found = {}
    for second in (False, True):
        for key in PRODUCTS if second else DRAWN:
            coordinate, form, variable = key
            shapes = DRAWN.get(key) or (_NOTHING, _MM if variable == "roll" else _RATE)
            other = PRODUCTS[key] if second else None
            sort = "two" if other else "inside" if form in INSIDE else "outside"
            name = "_".join(["law", *key, *([other[0]] if other else [])])
            found[name] = {
                "sort": sort, "form": form, "channel": coordinate, "prefix": "law", "parameter": "size",
                "depends_on": [variable, *([other[0]] if other else [])], "along": {}, "power": 1.0, "signed": True,
                "limits": (1e-4, 2.0) if coordinate == "roll" else (1e-3, 60.0),
                "shapes": _drawing(coordinate, form, variable, shapes, other),
            }  # fmt: skip
    return found


def _drawing(coordinate, form, variable, shapes, other):
    second, scale, power = other or ("time", 1.0, 0.0)

    def draw(rng, reach):
        return {
            "coordinate": float(COORDINATES.index(coordinate)), "form": float(FORMS.index(form)),
            "variable": float(VARIABLES.index(variable)), "a": shapes[0](rng, reach), "b": shapes[1](rng, reach),
            "second": float(VARIABLES.index(second)), "scale": scale, "power": power,
        }  # fmt: skip

    return draw


LAWS = _table()


def names(rng):
    """One law's name, the sort drawn first."""
    sort = str(rng.choice(list(SORTS), p=list(SORTS.values())))
    return str(rng.choice([n for n, row in LAWS.items() if row["sort"] == sort]))


def told(name, parameters):
    """What the truth says of a law: its sort, form, the power of the second variable that it is times (SI), and
    parameters by the page's names where the page has the form."""
    row = LAWS[name]
    size = parameters["size"] / parameters["scale"] ** parameters["power"]
    known = known_parameters(row["form"], size, parameters["a"], parameters["b"])
    return {"sort": row["sort"], "form": row["form"], "power": parameters["power"], "parameters": known}


def damping(name, size):
    """Whether the law takes energy away at this sign: rates are damped, springs pull back (a sign that nobody's rig
    would live with is turned)."""
    row = LAWS[name]
    back = row["depends_on"][0] in (row["channel"], f"{row['channel']}_rate") and row["channel"] != "surge"
    return -abs(size) if back and row["form"] != "exponential" else size
