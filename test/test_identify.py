# SPDX-License-Identifier: Apache-2.0
"""Identification: the answer is the data's, both methods find it, and the stated interval means what it says.

Idea: where the model is linear, standard errors and intervals are known in closed form; where it is the cradle, the
truth is known because the data were simulated, a hundred times over.
"""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from scipy import stats

from inductrack_ros import cli
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.core.parameters import Parameter
from inductrack_ros.data import load_campaign, write_csv
from inductrack_ros.estimation.identify import Identification, valley, verdict
from inductrack_ros.estimation.misfits import (
    JointMisfit,
    SeriesMisfit,
    TravelMisfit,
    Travels,
    declarations,
    read_travels,
)
from inductrack_ros.paper.identification import (
    CHOICES,
    FLAT_SPEEDS,
    REPLICATES,
    SPEEDS,
    STD,
    coverage,
    identify,
    precision,
    simulated,
)

TRUE = np.array([0.7295, 3.9298])
FREE = ("eta", "gamma")


@pytest.fixture(scope="module")
def model():
    return Model.default()


# ---------------------------------------------------------------- where the answer is known in closed form


class Toy:
    """Any function of two parameters a and b as a misfit."""

    nuisance = 0

    def __init__(self, residuals, noise_known=True, free=("a", "b")):
        self.residuals, self.noise_known, self.free = residuals, noise_known, free
        self.declared = [Parameter(1.0, "", -100.0, 100.0, name) for name in free]

    def __call__(self, values):
        return self.residuals(np.asarray(values))


X = np.column_stack([np.ones(12), np.linspace(-1, 2, 12)])
Y = X @ [2.0, 3.0] + np.random.default_rng(5).standard_normal(12)


def test_straight_line_in_closed_form():
    """Least squares, covariance and profile interval of a straight line are textbook."""
    question = Identification(Toy(lambda v: Y - X @ v), [1.0, 1.0])
    fit = question.fit()
    exact = np.linalg.lstsq(X, Y, rcond=None)[0]
    covariance = np.linalg.inv(X.T @ X)
    assert fit.values == pytest.approx(exact, rel=1e-8)
    assert fit.nelder_mead == pytest.approx(exact, rel=1e-6)
    assert fit.covariance == pytest.approx(covariance, rel=1e-6)
    assert fit.correlation[0, 1] == pytest.approx(
        covariance[0, 1] / math.sqrt(covariance[0, 0] * covariance[1, 1]), rel=1e-6
    )
    for i, name in enumerate("ab"):
        p = question.profile(fit, name)
        half = 1.959964 * math.sqrt(covariance[i, i])
        assert [p.low, p.high] == pytest.approx([exact[i] - half, exact[i] + half], rel=2e-4)
        assert question.covers(fit, name, p.low + 1e-3 * half) and not question.covers(fit, name, p.low - 1e-3 * half)


def test_unknown_noise_is_student():
    """With the noise estimated from the residuals the interval is Student's."""
    question = Identification(Toy(lambda v: Y - X @ v, noise_known=False), [1.0, 1.0])
    fit = question.fit(nelder_mead=False)
    exact, rest = np.linalg.lstsq(X, Y, rcond=None)[:2]
    s = math.sqrt(rest[0] / 10)
    assert fit.noise == pytest.approx(s, rel=1e-6)
    p = question.profile(fit, "b")
    half = stats.t.ppf(0.975, 10) * s * math.sqrt(np.linalg.inv(X.T @ X)[1, 1])
    assert [p.low, p.high] == pytest.approx([exact[1] - half, exact[1] + half], rel=2e-4)


def test_profile_of_a_bent_valley():
    """The interval of a in y = a² is not symmetric: its ends are the roots."""
    question = Identification(Toy(lambda v: np.array([(4.0 - v[0] ** 2) / 1.5]), free=("a",)), [1.0])
    fit = question.fit(nelder_mead=False)
    p = question.profile(fit, "a")
    assert [p.low, p.high] == pytest.approx([math.sqrt(4 - 1.96 * 1.5), math.sqrt(4 + 1.96 * 1.5)], rel=2e-3)


def test_only_the_product_shows():
    """y = a·b fixes neither a nor b: infinite intervals, a flat valley, and the product named."""
    t = np.linspace(1, 2, 6)
    question = Identification(Toy(lambda v: (6.0 * t - v[0] * v[1] * t) / 0.01), [1.5, 3.0])
    fit = question.fit()
    profiles = [question.profile(fit, n) for n in "ab"]
    assert all(p.flat and math.isinf(p.low) and math.isinf(p.high) for p in profiles)
    assert valley(fit).best_exponents == pytest.approx([1.0, 1.0], abs=1e-3)
    words = verdict(fit, profiles)
    assert "flat" in words and "do not determine a and b" in words and ("a · b" in words or "b · a" in words)


def test_residuals_beyond_the_stated_noise_are_remarked_upon():
    question = Identification(Toy(lambda v: (Y - X @ v) / 0.2), [1.0, 1.0])
    fit = question.fit(nelder_mead=False)
    words = verdict(fit, [question.profile(fit, n) for n in "ab"])
    assert "stated noise" in words and "too narrow" in words
    assert fit.chance == pytest.approx(stats.chi2.sf(fit.misfit, 10))


def test_too_few_measurements():
    with pytest.raises(InputError, match="1 measurements cannot fix 2"):
        Identification(Toy(lambda v: np.array([v[0] - 1.0])), [1.0, 1.0]).fit()
    with pytest.raises(InputError, match="give at least 3"):
        Identification(Toy(lambda v: v - 1.0, noise_known=False), [1.5, 1.5]).fit()


# ---------------------------------------------------------------- the cradle, from four distances


def test_both_methods_from_the_papers_start(model):
    """From η = 1, γ = 3, without noise: back to the published values, and the simplex and least squares agree."""
    answer = identify(model, simulated(model, SPEEDS, STD, None), (1.0, 3.0))
    assert answer.fit.values == pytest.approx(TRUE, rel=1e-6)
    assert answer.fit.nelder_mead == pytest.approx(answer.fit.values, rel=1e-5)
    assert answer.fit.misfit < 1e-6
    for p, true in zip(answer.profiles, TRUE, strict=True):
        assert p.low < true < p.high and not p.flat


def test_both_methods_agree_where_there_is_noise_and_contact(model):
    answer = identify(model, simulated(model, (15.0, 16.2, 17.0, 18.0), 0.2, np.random.default_rng(3)), (1.0, 3.0))
    assert answer.fit.nelder_mead == pytest.approx(answer.fit.values, rel=1e-5)
    assert np.abs((answer.fit.values - TRUE) / answer.fit.std).max() < 4


@pytest.mark.parametrize(("speeds", "exponent"), [(FLAT_SPEEDS, None), ((30.0, 32.0, 34.0, 36.0), None)])
def test_the_valley_by_the_distances_own_derivatives(model, speeds, exponent):
    """The best-determined combination's exponent is the ratio of the distances' sensitivities: the valley runs across
    it."""
    p = precision(model, speeds)
    along = p.valley.worst_exponents
    values = TRUE * (1 + 1e-3 * along / np.abs(along).max())
    misfit = TravelMisfit(model, FREE, simulated(model, speeds, STD, None))
    across = TRUE * (1 + 1e-3 * p.valley.best_exponents / np.abs(p.valley.best_exponents).max())
    assert np.linalg.norm(misfit(across)) > 20 * np.linalg.norm(misfit(values))


def test_choice_of_speeds_decides(model):
    """Starts that all touch down say over twenty times less about η than starts on both sides of the critical speed."""
    found = {p.speeds: p for p in (precision(model, s) for s in CHOICES)}
    assert found[FLAT_SPEEDS].relative_std[0] > 20 * found[CHOICES[-1]].relative_std[0]
    assert found[FLAT_SPEEDS].correlation > 0.999 > 0.9 > found[CHOICES[-1]].correlation


def test_mass_beside_eta_and_gamma_cannot_be_told(model):
    """Without contact only η/m and γ/m show: three free parameters leave a line along which nothing changes."""
    misfit = TravelMisfit(model, ("eta", "gamma", "mass"), simulated(model, (17.0, 18.0, 19.0, 20.0), STD, None))
    exact = misfit([*TRUE, 9.3])
    assert misfit([*(1.1 * TRUE), 1.1 * 9.3]) == pytest.approx(exact, abs=1e-6)
    question = Identification(misfit, [*TRUE, 9.3])
    fit = question.fit(nelder_mead=False)
    assert np.linalg.eigvalsh(fit.correlation)[-1] == pytest.approx(3.0, abs=1e-3)
    assert question.profile(fit, "mass").flat


def test_coverage(model):
    """Four distances with noise, a hundred times: each stated 95 % interval holds the truth about 95 times (binomial:
    90 to 99), no side favoured."""
    held, answers = coverage(model)
    assert REPLICATES == 100 and len(answers) == 100
    for name in FREE:
        assert 90 <= held[name] <= 99, held
    above = (answers > TRUE).sum(axis=0)
    assert ((above > 30) & (above < 70)).all(), above


def test_coverage_with_the_noise_estimated(model):
    held, _ = coverage(model, replicates=30, seed=7, noise_known=False)
    assert all(25 <= n <= 30 for n in held.values()), held


def test_travel_is_the_simulators(model):
    """The fast path of the fit and a plain simulation give the same distance; a current and a duration are used."""
    travels = Travels.of([14.0, 17.0], [0.0, 0.0], duration=[1.0, 2.0], drive_current=[0.0, 7000.0])
    found = TravelMisfit(model, FREE, travels).predict([0.8, 3.5])
    other = model.with_changes({"eta": 0.8, "gamma": 3.5})
    for z, v, t, current in zip(found, (14.0, 17.0), (1.0, 2.0), (0.0, 7000.0), strict=True):
        run = other.simulate(np.array([0.0, t]), other.initial_state(surge_rate=v), current)
        assert z == pytest.approx(run["surge"][-1], abs=1e-9)


# ---------------------------------------------------------------- time series, and both


@pytest.fixture(scope="module")
def campaign(tmp_path_factory, model):
    """Two runs of 0.4 s with surge and heave, of a rig with another η and γ."""
    folder = tmp_path_factory.mktemp("rig")
    rig, rng = model.with_changes({"eta": 0.75, "gamma": 3.85}), np.random.default_rng(11)
    times = np.arange(161) / 400
    runs = []
    for i, (speed, current) in enumerate(((18.0, 7000.0), (25.0, 0.0))):
        run = rig.simulate(times, rig.initial_state(surge_rate=speed, heave=-0.0045), current)
        noisy = {c: run[c] + s * rng.standard_normal(len(times)) for c, s in (("surge", 5e-4), ("heave", 3e-5))}
        write_csv(folder / f"run_{i}.csv", times, noisy)
        runs.append({"file": f"run_{i}.csv", "drive_current": current})
    (folder / "campaign.yaml").write_text(
        yaml.safe_dump({"name": "two", "runs": runs, "noise_std": {"surge": 5e-4, "heave": 3e-5}})
    )
    return load_campaign(folder)


def test_time_series(model, campaign):
    misfit = SeriesMisfit(campaign, model, FREE)
    question = Identification(misfit, misfit.start)
    fit = question.fit()
    assert np.abs((fit.values - [0.75, 3.85]) / fit.std).max() < 4
    assert fit.nelder_mead == pytest.approx(fit.values, rel=1e-5)
    assert fit.degrees == 4 * 161 - 2 - 2 * 4, "two parameters, and in each run place, speed, heave and its rate"
    assert (np.abs(fit.values - [misfit.found.values[n] for n in FREE]) < 0.05 * fit.std).all()
    # the initial states are free beside the parameters: the standard errors are the campaign fit's, where they are
    # eliminated
    assert fit.std == pytest.approx([misfit.found.deviations[n] for n in FREE], rel=0.02)
    assert 1e-3 < fit.chance


def test_both_together_are_sharper_than_each(model, campaign):
    rig = model.with_changes({"eta": 0.75, "gamma": 3.85})
    distances = TravelMisfit(model, FREE, simulated(rig, SPEEDS, STD, np.random.default_rng(4)))
    series = SeriesMisfit(campaign, model, FREE)
    alone = [Identification(m, series.start).fit(nelder_mead=False) for m in (distances, series)]
    both = Identification(JointMisfit([distances, series]), series.start).fit(nelder_mead=False)
    assert (both.std < np.minimum(alone[0].std, alone[1].std)).all()
    assert np.abs((both.values - [0.75, 3.85]) / both.std).max() < 4


def test_noise_of_a_series_is_estimated_where_it_is_not_given(model, campaign):
    from dataclasses import replace

    misfit = SeriesMisfit(replace(campaign, noise_std={}), model, FREE)
    given = dict(zip(misfit.problem.channels, misfit.problem.sigma, strict=True))
    assert given == {"surge": pytest.approx(5e-4, rel=0.2), "heave": pytest.approx(3e-5, rel=0.2)}


def test_both_together_need_the_distances_noise(model, campaign):
    distances = TravelMisfit(model, FREE, Travels.of([16.0, 17.0], [30.0, 75.0]))
    with pytest.raises(InputError, match="std"):
        JointMisfit([distances, SimpleNamespace(free=FREE, noise_known=True, nuisance=0)])


# ---------------------------------------------------------------- the command


GOOD = "initial_speed,travel\n16,30.9\n16.5,53.8\n17,75.25\n18,114.1\n"


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("", "travels.csv: empty; it needs a header"),
        ("initial_speed,distance\n16,30\n", "row 1: unknown column 'distance'"),
        ("initial_speed,travel,travel\n16,30,30\n", "row 1: needs one column 'travel'"),
        ("initial_speed,travel\n", "no row of data"),
        ("initial_speed,travel\n16,30\n17\n", "row 3: 1 cells where the header names 2"),
        ("initial_speed,travel\n16,far\n", "row 2, column 'travel': 'far' is not a number"),
        ("initial_speed,travel\n16,nan\n", "row 2, column 'travel'"),
        ("initial_speed,travel\n\n-16,30\n", "row 3, column 'initial_speed': '-16' is not a positive number"),
        ("initial_speed,travel,std\n16,30,0\n", "row 2, column 'std'"),
        ("initial_speed,travel\n16,30\n", "1 measurements cannot fix 2 parameters; give at least 3"),
    ],
)
def test_broken_tables(tmp_path, capsys, text, place):
    file = tmp_path / "travels.csv"
    file.write_text(text)
    assert cli.main(["fit", str(file), "--output", str(tmp_path / "out")]) == 2
    message = capsys.readouterr().err
    assert place in message and message.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "place"),
    [
        (["--free", "eta,gamm"], "did you mean 'gamma'?"),
        (["--free", "eta,eta"], "name each once"),
        (["--start", "eta=one"], "--start: 'eta=one' is not NAME=NUMBER"),
        (["--start", "mass=9"], "add it to --free"),
        (["--start", "eta=-1"], "eta = -1 is out of range"),
        (["--std", "0"], "--std 0: must be above 0"),
        (["--model", "/no/such.yaml"], "no such file"),
    ],
)
def test_broken_options(tmp_path, capsys, options, place):
    file = tmp_path / "travels.csv"
    file.write_text(GOOD)
    assert cli.main(["fit", str(file), "--output", str(tmp_path / "out"), *options]) == 2
    message = capsys.readouterr().err
    assert place in message and message.count("\n") == 1


@pytest.mark.parametrize(
    "text",
    [
        "initial_speed;travel\n16;30,9\n15,5;20\n",
        "sep=;\n# distances\ninitial_speed [km/h];travel [cm];\n57,6;3090;\n55,8;2000;\n",
        "initial_speed\ttravel\r\n16\t30.9\r\n15.5\t20\r\n",
        '"initial_speed","travel"\n"16","30.9"\n"15.5","20"\n'.encode("utf-16"),
    ],
)
def test_dialects_of_tables(tmp_path, text):
    file = tmp_path / "travels.csv"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    travels = read_travels(file)
    assert travels.initial_speed == pytest.approx([16, 15.5]) and travels.travel == pytest.approx([30.9, 20])
    assert bool(travels.notes) == (b"km/h" in file.read_bytes())


def test_columns_beside_the_pair(tmp_path):
    file = tmp_path / "travels.csv"
    file.write_text("\ufefftravel, initial_speed ,duration,std\n30.9,16,2,0.05\n\n20,15,1.5,0.1\n", encoding="utf-8")
    travels = read_travels(file)
    assert (
        travels.initial_speed.tolist() == [16, 15]
        and travels.duration.tolist() == [2, 1.5]
        and travels.std.tolist() == [0.05, 0.1]
    )
    assert np.isnan(travels.drive_current).all()


def test_effect_parameters_can_be_fitted(model):
    with_drag = model.with_changes(effects={"aerodynamic_drag": {"drag_area": 0.02}})
    assert declarations(with_drag, ["aerodynamic_drag.drag_area"])[0].unit == "m²"
    speeds = (16.2, 17.0, 18.0, 25.0, 30.0)
    travels = simulated(with_drag, speeds, 1e-3, None)
    start = model.with_changes(effects={"aerodynamic_drag": {"drag_area": 0.0}})
    misfit = TravelMisfit(start, (*FREE, "aerodynamic_drag.drag_area"), travels)
    fit = Identification(misfit, [*TRUE, 0.0]).fit(nelder_mead=False)
    assert fit.values == pytest.approx([*TRUE, 0.02], rel=1e-3)


def test_fit_from_the_command_line(tmp_path, capsys, campaign):
    """Distances and series at once; what is written can be read, and the fitted model runs."""
    file, out = tmp_path / "travels.csv", tmp_path / "deep" / "out"
    rig = Model.default().with_changes({"eta": 0.75, "gamma": 3.85})
    t = simulated(rig, SPEEDS, STD, np.random.default_rng(4))
    file.write_text(
        "initial_speed,travel\n" + "".join(f"{v},{z}\n" for v, z in zip(t.initial_speed, t.travel, strict=True))
    )
    assert cli.main(["fit", str(file), str(campaign.folder), "--std", "0.05", "--output", str(out)]) == 0
    result = json.loads((out / "fit.json").read_text(encoding="utf-8"))
    fitted = Model.load(out / "model.yaml")
    for name, true in (("eta", 0.75), ("gamma", 3.85)):
        found = result["parameters"][name]
        assert found["value"] == fitted.parameters[name] == pytest.approx(true, abs=4 * found["std"])
        assert found["nelder_mead"] == pytest.approx(found["value"], rel=1e-5)
        low, high = found["interval"]
        assert low < found["value"] < high
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "4 travel distances and campaign two" in page and "run_1" in page
    assert result["verdict"] in capsys.readouterr().out
    assert sorted(f.name for f in out.iterdir()) == ["fit.json", "model.yaml", "report.html"]
