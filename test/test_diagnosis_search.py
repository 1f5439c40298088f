# SPDX-License-Identifier: Apache-2.0
"""The search's own logic, apart from any fit: what bounded candidates promise, and when the search ends."""

from types import SimpleNamespace

import numpy as np
import pytest

from inductrack_ros.core.effects.stand_in import basis, over
from inductrack_ros.diagnosis import strategy
from inductrack_ros.diagnosis.moves import State, Task
from inductrack_ros.diagnosis.smooth import smoothest_of
from inductrack_ros.estimation.scores import Background, Level, Scores

NO_POWER = np.zeros(4)


def scores(residual: np.ndarray, columns: dict[str, np.ndarray], bounds: dict[str, tuple[float, float]]) -> Scores:
    """The scores of columns (n,) at a residual (n,) = data − model, nothing else to be fitted."""
    whole = np.column_stack([-residual, *columns.values()])
    level = Level(NO_POWER, Background(NO_POWER, ()), whole.T @ whole, 0.0)
    places = {name: np.array([k]) for k, name in enumerate(columns)}
    return Scores(0, np.zeros((0, 0)), np.zeros(0), places, (level,), np.array([bounds[n] for n in columns]))


def test_a_size_that_an_effect_cannot_have_promises_nothing():
    """What pushes is no drag, although a negative drag would explain it all."""
    rng = np.random.default_rng(0)
    drag = rng.standard_normal(50)
    found = scores(-3.0 * drag, {"drag": drag}, {"drag": (0.0, np.inf)})
    assert found.expected(["drag"]).deviance == pytest.approx(found.plain)
    assert found.unbounded.expected(["drag"]).size == pytest.approx([-3.0], rel=1e-4)


def test_beside_one_at_its_bound_the_other_is_fitted_anew():
    rng = np.random.default_rng(1)
    a = rng.standard_normal(200)
    b = a + 0.5 * rng.standard_normal(200)
    residual = -a + 2.0 * b
    found = scores(residual, {"a": a, "b": b}, {"a": (0.0, np.inf), "b": (-np.inf, 1.9)})
    e = found.expected(["a", "b"])
    tried = [residual - x * a - y * b for x in (0.0, 1e-3) for y in (*np.linspace(0.5, 1.9, 1401),)]
    assert e.size[0] == 0.0 and e.size[1] <= 1.9
    assert e.deviance == pytest.approx(min(float(r @ r) for r in tried), rel=1e-3)


def search_with(monkeypatch, add, revise) -> State:
    """A search whose only stages turn the names that were added into others; nothing is promised beside these."""

    def stage(of):
        return lambda task, state: State(SimpleNamespace(deviance=0.0), tuple(of(state.added)))

    monkeypatch.setattr(strategy, "ADDING", (("add", stage(add)),))
    monkeypatch.setattr(strategy, "REVISING", (("revise", stage(revise)),))
    monkeypatch.setattr(strategy, "last_screened", lambda task, state: state)
    monkeypatch.setattr(strategy, "unkept", lambda state: "")
    return strategy.search(Task(None), State(SimpleNamespace(deviance=0.0)))


def test_what_revising_took_out_makes_room_for_another(monkeypatch):
    """Three effects fill the search; one is not needed once the others are right, and what it stood for is added."""

    def add(have):
        if not have:
            return ("droop", "damping", "air_drag")
        return (*have, "viscous_drag") if set(have) == {"droop", "damping"} else have

    def revise(have):
        return tuple(n for n in have if n != "air_drag")

    assert search_with(monkeypatch, add, revise).added == ("droop", "damping", "viscous_drag")


def test_a_search_that_goes_round_in_circles_ends(monkeypatch):
    asked = []

    def add(have):
        asked.append(have)
        return ("a",) if have != ("a",) else have

    assert search_with(monkeypatch, add, lambda have: ("b",)).added == ("b",)
    assert len(asked) < 10


@pytest.mark.parametrize("edge", [0.0, 1.0])
def test_a_table_is_as_free_at_its_ends_as_within(edge):
    """A cubic is one of its curves up to the last reading."""
    u = np.linspace(-2.0, 3.0, 400)
    shapes = basis(u, *over(-2.0, 3.0, 8))
    wanted = (u - edge) ** 3 - 2.0 * u
    values = np.linalg.lstsq(shapes, wanted, rcond=None)[0]
    assert np.abs(shapes @ values - wanted).max() < 1e-9


def test_a_force_that_oscillates_costs_a_few_values():
    """Eleven periods in noise: a table that is to be straight takes the noise for bends as well."""
    rng = np.random.default_rng(2)
    t = np.linspace(0.0, 1.2, 1500)
    shapes = basis(t, *over(0.0, 1.2, 120))
    gram = shapes.T @ shapes
    y = 0.5 * np.sin(2 * np.pi * 9.36 * t + 1.0) + rng.standard_normal(len(t))
    straight, swinging = (smoothest_of(gram, shapes.T @ y, len(t), swings) for swings in (False, True))
    assert swinging.smoothness.turn / (2 * np.pi) * 100.0 == pytest.approx(9.36, abs=0.5 / 1.2)  # 100 values a second
    assert swinging.promise > straight.promise + 50.0 and swinging.occam < 0.5 * straight.occam
    noise = [smoothest_of(gram, shapes.T @ rng.standard_normal(len(t)), len(t), True) for _ in range(30)]
    assert max(s.promise for s in noise) < 0.0


def found(added, cost, exact=False):
    """What a search may hold: effects, and what the state with them costs."""
    force = any(n.startswith("stand_in") for n in added)
    known = tuple(n for n in added if not n.startswith("stand_in"))
    return SimpleNamespace(
        added=added, known=known, stands_in=force, cost=lambda task: cost, fit=SimpleNamespace(exact=exact)
    )


@pytest.mark.parametrize("cheaper, wins", [(strategy.SURER + 1.0, True), (strategy.SURER - 1.0, False)])
def test_several_known_effects_give_way_to_a_force_on_two_variables(monkeypatch, cheaper, wins):
    """It is sought beside none of them, and has to be surely cheaper."""
    asked = []
    product = found(("stand_in_heave",), 100.0 - cheaper)
    monkeypatch.setattr(strategy, "without", lambda task, state, name: found((), 130.0))
    monkeypatch.setattr(strategy, "add_pair", lambda task, state: asked.append(state.added) or product)
    several = found(("viscous_drag", "aerodynamic_lift"), 100.0)
    chosen = strategy.product_instead(None, found(("viscous_drag",), 120.0), several)
    assert (chosen is product) == wins and asked == [()]


def test_what_lets_contact_be_exact_is_compared_with_no_other(monkeypatch):
    """Its cost counts what is read during contacts too."""
    monkeypatch.setattr(strategy, "add_background", lambda task, state: state)
    right, wrong = found(("stand_in_heave",), 7587.0, exact=True), found(("viscous_drag",), 2883.0)
    assert strategy.best_beside_its_noise(None, (right, wrong)) is right
    assert strategy.best_beside_its_noise(None, (found(("a",), 5.0), wrong)).added == ("a",)
