# SPDX-License-Identifier: Apache-2.0
"""How well closed forms are told from the table of an unknown force: laws drawn at random, tables with noise as the
fits give them.

    python benchmarks/laws.py --tables 400 --seed 1
    python benchmarks/laws.py --tables 120 --seed 1 --peers    # other tools on the same tables, side by side

Each table is made of samples of a force along runs (where the variable dwells as runs do, with gaps), noise, and a
smoothness chosen by evidence as in a diagnosis. Laws are drawn from the list and from outside it. Printed: how often
the right law is in the set that the data cannot tell apart, how large that set is, how often a law is claimed where the
truth is outside the list, and how often parameters lie in their 95 % intervals. No simulation is run, so this measures
the choice among forms alone.

With ``--peers`` the same statements are put to PySINDy and to a general expression search (`peers.laws`). Each answer
is held against the true law by `peers.law_judge`: the package's is the first law of its set."""

from __future__ import annotations

import argparse
import collections
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from peers import laws
from peers.law_judge import Force
from peers.law_versus import CURVE, MINE, Answer, Row, asked, judged, line, table

from inductrack_ros.core.effects.stand_in import basis, over, parameters
from inductrack_ros.diagnosis.laws.fitting import Fitted, Table, fitted, likely
from inductrack_ros.diagnosis.laws.forms import ALONG, Form, Range, forms_on
from inductrack_ros.diagnosis.settings import FINE, MEDIUM, TWINS
from inductrack_ros.diagnosis.smooth import smoothest_of

#: What runs cover of each variable: low and high, drawn between.
COVERED = {
    "surge": ((0.0, 0.0), (15.0, 45.0)),
    "time": ((0.0, 0.0), (0.8, 2.0)),
    "surge_rate": ((10.0, 18.0), (24.0, 40.0)),
    "sway": ((-4e-3, -2e-3), (2e-3, 4e-3)),
    "heave": ((-7e-3, -5.5e-3), (-4e-3, -2e-3)),
    "sway_rate": ((-0.5, -0.2), (0.2, 0.5)),
}
#: A law that changes by less than this part of itself over the range is a constant there, and is drawn again.
FLAT = 0.01


def drawn_shape(rng, form: Form, r: Range) -> dict[str, float]:
    """Shape parameters such that the form shows its shape within the range."""
    L, far = r.length, r.far
    of = {
        "place": lambda: r.low + L * rng.uniform(0.25, 0.75),
        "width": lambda: L * np.exp(rng.uniform(np.log(0.03), np.log(0.3))),
        "gap": lambda: far * rng.uniform(0.1, 0.5),
        "power": lambda: rng.choice([rng.uniform(0.4, 0.8), rng.uniform(1.3, 1.8), rng.uniform(2.3, 2.8)]),
        "length": lambda: r.low + L * rng.uniform(0.2, 0.8) if r.low > 0 else far * rng.uniform(0.2, 0.8),
        "signed length": lambda: L * rng.uniform(0.2, 0.8) * rng.choice([-1, 1]),
        "wavelength": lambda: L * rng.uniform(0.08, 0.8),
        "phase": lambda: rng.uniform(-np.pi, np.pi),
    }
    return {s.name: float(of[s.kind]()) for s in form.shapes}


def inside(rng, variable: str, u: np.ndarray, r: Range):
    """A law of the list that shows its shape: its form, and parameters at a scale of one over samples at u."""
    while True:
        form = rng.choice([f for f in forms_on(variable, "heave") if f.name != "constant"])
        shape = drawn_shape(rng, form, r)
        columns = form.columns(u, list(shape.values()))
        sizes = {
            t.size: float(rng.choice([-1, 1]) * rng.uniform(0.6, 1.4) / np.sqrt(np.mean(c**2)))
            for t, c in zip(form.terms, columns, strict=True)
        }
        force = form.value(u, {**sizes, **shape})
        if np.std(force) > FLAT * np.sqrt(np.mean(force**2)):
            return form, {**sizes, **shape}


def outside(rng, r: Range):
    """A force that no form of the list is: what it is called, and the force as a function of u."""
    a, b, c = rng.uniform(0.2, 0.8), rng.uniform(0.05, 0.15), rng.uniform(2, 5)

    def two_bumps():
        less = rng.uniform(0.4, 1)
        return lambda x: np.exp(-(((x - 0.4 * a) / b) ** 2)) - less * np.exp(-(((x - 0.5 - 0.5 * a) / b) ** 2))

    def quintic():
        sizes = rng.standard_normal(6) * [0, 0.3, 0.6, 1, 1, 1]
        return lambda x: np.polynomial.chebyshev.chebval(2 * x - 1, sizes)

    def rough():
        waves = [(rng.standard_normal() / k, np.pi * k, rng.uniform(0, 6)) for k in range(1, 9)]
        return lambda x: sum(size * np.sin(k * x + phase) for size, k, phase in waves)

    shapes = {
        "two bumps": two_bumps,
        "growing sine": lambda: lambda x: np.exp(3 * x) * np.sin(2 * np.pi * c * x),
        "chirp": lambda: lambda x: np.sin(2 * np.pi * (x + c * x**2)),
        "sawtooth": lambda: lambda x: (c * x) % 1.0,
        "staircase": lambda: lambda x: np.tanh((x - 0.4 * a) / 0.03) + np.tanh((x - 0.5 - 0.4 * a) / 0.03),
        "resonance": lambda: lambda x: (a - x) / ((x - a) ** 2 + b**2),
        "quintic": quintic,
        "rough": rough,
    }
    name = str(rng.choice(list(shapes)))
    shape = shapes[name]()
    return name, lambda u: shape((u - r.low) / r.length)


def told(rng, variable: str, r: Range, u: np.ndarray, force: np.ndarray, noise: float) -> tuple[laws.Statement, Force]:
    """What samples of the force say of its table, of the size that a diagnosis would choose, and its smooth curve."""
    y = force + noise * rng.standard_normal(len(u))
    found = []
    for intervals in (MEDIUM, FINE) if variable in ALONG else (MEDIUM,):
        about = over(r.low, r.low + r.length, intervals)
        B = basis(u, *about)
        gram, score = B.T @ B / noise**2, B.T @ y / noise**2
        found.append((smoothest_of(gram, score, len(u), variable in ALONG), about, gram, score))
    smooth, (low, step, count), gram, score = max(found, key=lambda f: f[0].promise)
    table = Table.of("heave", parameters(variable, low, step), gram, score)
    known = gram + smooth.smoothness.weight * smooth.smoothness.bending(count)
    known += np.eye(count) * np.trace(gram) / count / len(u)  # what `smoothest_of` takes for known before the data
    shapes = basis(table.u, low, step, count)
    std = np.sqrt(np.einsum("ij,ji->i", shapes, np.linalg.solve(known, shapes.T)))
    statement = laws.Statement(table, table.u, shapes @ smooth.values, std, len(u))
    return statement, lambda u: basis(u, low, step, count) @ smooth.values


def samples_of(rng, variable: str, r: Range, n: int) -> np.ndarray:
    """Where runs dwell: everywhere along the track and in time, most near the middle of an oscillation."""
    if variable in ("surge", "time", "surge_rate"):
        u = rng.uniform(r.low, r.high, n)
    else:
        middle = 0.5 * (r.low + r.high)
        u = middle + 0.5 * r.length * np.sin(rng.uniform(0, 2 * np.pi, n)) * np.sqrt(rng.uniform(0, 1, n))
    return np.sort(u)


def first(found: Sequence[Fitted], cpu: float) -> Answer | None:
    """The package's answer: the first law of its set, if any."""
    if not found:
        return None
    form, values = found[0].form, found[0].parameters
    return Answer(partial(form.value, parameters=values), len(form.terms), form.name, cpu)


def scaled(law: Force, scale: float) -> Force:
    """The law times a scale."""
    return lambda u: scale * law(u)


@dataclass(frozen=True)
class Drawn:
    """A law drawn at random over a variable's range, at a scale of one, and the samples (n,) that tell of it.

    ``what`` is its form with the parameters ``truth`` if it is of the list, else what it is called."""

    variable: str
    range: Range
    u: np.ndarray
    what: Form | str
    truth: dict[str, float]
    law: Force

    @property
    def title(self) -> str:
        """What it is called."""
        return self.what.name if isinstance(self.what, Form) else self.what


def drawn(rng, of_list: bool) -> Drawn:
    """A law of the list, or of none of its forms."""
    variable = str(rng.choice(list(COVERED)))
    low, high = (rng.uniform(*pair) for pair in COVERED[variable])
    r = Range(float(low), float(high))
    u = samples_of(rng, variable, r, int(rng.integers(1000, 8000)))
    if of_list:
        form, truth = inside(rng, variable, u, r)
        return Drawn(variable, r, u, form, truth, partial(form.value, parameters=truth))
    name, law = outside(rng, r)
    return Drawn(variable, r, u, name, {}, law)


class Score:
    """How often laws of the list were told, and others taken for one."""

    def __init__(self) -> None:
        self.counts: collections.Counter[str] = collections.Counter()
        self.missed: collections.Counter[tuple[str, str]] = collections.Counter()
        self.sets: list[int] = []
        self.covered: list[bool] = []

    def add(self, one: Drawn, scale: float, found: Sequence[Fitted]) -> None:
        """Count one law at a scale, and the set of forms that was found for it."""
        if not isinstance(one.what, Form):
            self.counts.update({"outside": 1, "false": bool(found), "one false": len(found) == 1})
            if found:
                self.missed[one.title, found[0].form.name] += 1
            return
        mine = next((f for f in found if f.form.name == one.title), None)
        alone = len(found) == 1 and mine is not None
        self.counts.update({"inside": 1, "in the set": mine is not None, "said none": not found, "alone": alone})
        self.sets.append(len(found))
        if mine is None:
            self.missed[one.title, found[0].form.name if found else "none"] += 1
            return
        sizes = {t.size for t in one.what.terms}
        for p, v in one.truth.items():
            off = mine.parameters[p] - v * (scale if p in sizes else 1.0)
            off = (off + np.pi) % (2 * np.pi) - np.pi if p == "phase" else off
            self.covered.append(abs(off) < 1.96 * mine.deviations[p])

    def lines(self) -> list[str]:
        """What is printed."""
        i, o = max(self.counts["inside"], 1), max(self.counts["outside"], 1)
        share = {n: f"{100 * self.counts[n] / i:.0f} %" for n in ("in the set", "alone", "said none")}
        wrong = {n: f"{100 * self.counts[n] / o:.0f} %" for n in ("false", "one false")}
        return [
            f"laws of the list: {i}; right law in the set {share['in the set']}, alone {share['alone']}, none said"
            f" {share['said none']}, forms in the set {np.mean(self.sets):.1f}",
            f"their parameters in the 95 % interval: {100 * np.mean(self.covered):.0f} % of {len(self.covered)}",
            f"laws outside the list: {o}; a law of the list claimed {wrong['false']}, one alone {wrong['one false']}",
        ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tables", type=int, default=400)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--misses", action="store_true", help="print every law that was missed or wrongly claimed")
    parser.add_argument("--peers", action="store_true", help="PySINDy and an expression search on the same tables too")
    given = parser.parse_args()
    rows: dict[bool, list[Row]] = {True: [], False: []}
    rng, score = np.random.default_rng(given.seed), Score()
    for k in range(given.tables):
        of_list = k % 2 == 0
        one = drawn(rng, of_list)
        scale = 1.0 / np.std(one.law(one.u))
        signal = float(np.exp(rng.uniform(np.log(15.0), np.log(300.0))))  # over noise, all samples together
        noise = np.sqrt(len(one.u)) / signal
        statement, curve = told(rng, one.variable, one.range, one.u, one.law(one.u) * scale, noise)
        began = time.process_time()
        found = likely(fitted(statement.table, len(one.u)), TWINS)
        score.add(one, scale, found)
        if given.peers:
            mine = first(found, time.process_time() - began)
            answers = {CURVE: Answer(curve, 0, "", 0.0), MINE: mine, **asked(statement)}
            row = judged(answers, scaled(one.law, scale), one.what if of_list else None, one.variable, one.range)
            rows[of_list].append(row)
            print(f"{k + 1}: {one.title} on {one.variable}\n{line(row)}", flush=True)
    print("\n".join(score.lines()))
    for (truth, said), times in score.missed.most_common() if given.misses else ():
        print(f"  {truth}: {said}, {times}")
    for of_list, title in ((True, "laws of the list"), (False, "laws outside the list")):
        if lines := table(rows[of_list], title):
            print("\n" + "\n".join(lines))


if __name__ == "__main__":
    main()
