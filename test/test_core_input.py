# SPDX-License-Identifier: Apache-2.0
"""What a user can get wrong in a model file or a call, one broken input per failure; and that good input comes back.

Idea: whatever stands in a file, the answer is a model or one line that names the place and the remedy, never a
traceback; and what `save` writes, `load` reads to the same model.
"""

import dataclasses
import math

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from inductrack_ros.core.effects import catalogue
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model, Pulses
from inductrack_ros.core.parameters import PARAMETERS

QUICK = settings(deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])

BROKEN = {
    "not YAML": ("mass: 9.3\neta: [1, 2\n", r"line 3: not valid YAML"),
    "a tab": ("mass: 9.3\n\teta: 1.0\n", r"line 2: not valid YAML"),
    "no mapping": ("- 9.3\n", "expected parameter names with values, got list"),
    "empty": ("", "empty; expected parameter names with values"),
    "unknown parameter": ("masss: 9.3\n", "unknown parameter 'masss'; did you mean 'mass'"),
    "not a number": ("mass: .nan\n", r"mass = nan is out of range.* kg"),
    "negative mass": ("mass: -9.3\n", r"mass = -9.3 is out of range; it must lie in \[0.001, 100000\] kg"),
    "infinite": ("mass: .inf\n", "mass = inf is out of range"),
    "huge integer": ("mass: 1" + "0" * 400 + "\n", "mass = inf is out of range"),
    "monstrous integer": ("mass: 1" + "0" * 5000 + "\n", "not valid YAML"),
    "text": ("mass: heavy\n", "mass = 'heavy' is not a number"),
    "a truth": ("mass: yes\n", "mass = True is not a number"),
    "nothing": ("mass:\n", "mass has no value"),
    "a date": ("mass: 2026-11-22\n", "mass = datetime.date.* is not a number"),
    "no date": ("mass: 2026-99-99\n", "not valid YAML"),
    "a list": ("mass: [9.3]\n", r"mass = \[9.3\] is not a number"),
    "a mapping": ("mass: {kg: 9.3}\n", "unknown effect 'mass'"),
    "dof 3": ("dof: 3\n", "dof = 3; it must be 1, 2, 4 or a list of surge, sway, heave, roll"),
    "dof a list": ("dof: [4]\n", r"dof = \[4\]; it must be 1, 2, 4 or a list of surge, sway, heave, roll"),
    "dof true": ("dof: true\n", "dof = True; it must be 1, 2, 4 or a list of surge, sway, heave, roll"),
    "drive": ("drive: pulse\n", "drive = 'pulse'; it must be 'averaged' or 'pulses'"),
    "unknown effect": ("effects: [viscous_dragg]\n", "unknown effect 'viscous_dragg'; did you mean 'viscous_drag'"),
    "effects a number": ("effects: 3\n", "effects must be a list of names, got 3"),
    "effects of numbers": ("effects: [3]\n", r"effects must be a list of names, got \[3\]"),
    "effect out of range": (
        "effects: [viscous_drag]\nviscous_drag: {coefficient: -1.0}\n",
        r"viscous_drag.coefficient = -1 is out .*\[0, 1000\] N·s/m",
    ),
    "effect's parameter": (
        "effects: [viscous_drag]\nviscous_drag: {coeff: 1.0}\n",
        "has no parameter 'coeff'; did you mean 'coefficient'",
    ),
    "parameter of an effect that is off": ("viscous_drag: {coeff: 1.0}\n", "has no parameter 'coeff'"),
    "sensor without channel": ("effects: [sensor_delay]\n", "needs a channel, e.g. 'sensor_delay:heave'"),
    "sensor's channel": ("effects: ['sensor_delay:heav']\n", "did you mean 'heave'"),
    "channel of a force": ("effects: ['viscous_drag:heave']\n", "is not a sensor's, it takes no channel"),
    "given twice": ("mass: 9.3\neta: 0.7\nmass: 9.4\n", "line 3: .*'mass' is given twice"),
    "alias": ("eta: &a 0.7\ngamma: *a\n", "line 2: .*aliases"),
    "refers to itself": ("a: &a\n  b: *a\n", "line 2: .*aliases"),
    "a tag": ("mass: !!python/object/apply:os.system [echo]\n", "line 1: not valid YAML"),
    "deep": ("{a: " * 2000 + "1" + "}" * 2000, "nested too deep"),
    "deepish": ("{a: " * 20 + "1" + "}" * 20, "nested too deep"),
    "deep list": ("[" * 5000, "nested too deep"),
    "no parameters in the block": ("/**:\n  ros__parameters: 3\n", "ros__parameters must hold parameter names"),
    "a key that is a list": ("? [a]\n: 1\n", "not valid YAML"),
    "a key of two lines": ('"ma\\nss": 1\n', "unknown parameter 'ma ss'"),
    "control character": ("mass: \x01\n", "not valid YAML"),
    "effect file": ("effect_files: [nowhere.py]\n", "nowhere.py: no such file"),
    "effect file's home": ("effect_files: ['~nobody_at_all/x.py']\n", "x.py"),
    "effect file with a null": ('effect_files: ["a\\0b.py"]\n', "cannot be read"),
}


@pytest.mark.parametrize("mistake", BROKEN)
def test_broken_file(tmp_path, mistake):
    content, message = BROKEN[mistake]
    path = tmp_path / "rig.yaml"
    path.write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        Model.load(path)
    text = str(caught.value)
    assert "rig.yaml" in text or "effect file" in text
    assert "\n" not in text
    assert len(text) < 1200


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match="nowhere.yaml: no such file"):
        Model.load(tmp_path / "nowhere.yaml")
    with pytest.raises(InputError, match="cannot be read"):
        Model.load(tmp_path)
    (tmp_path / "latin.yaml").write_bytes("name: Düse\n".encode("latin-1"))
    with pytest.raises(InputError, match="latin.yaml: cannot be read"):
        Model.load(tmp_path / "latin.yaml")


# -- good input -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "content",
    [
        "mass: 10\neffects: [viscous_drag]\nviscous_drag: {coefficient: 2.5}\n",
        "mass: 1e1\neffects: viscous_drag\nviscous_drag.coefficient: 25e-1\n",
        (
            "/**:\n  ros__parameters:\n    mass: 10.0\n    effects: [viscous_drag]\n    viscous_drag:\n     "
            " coefficient: 2.5\n"
        ),
        (
            "/inductrack:\n  sim:\n    ros__parameters: {mass: 10.0, effects: ['viscous_drag'],"
            " viscous_drag.coefficient: 2.5}\n"
        ),
    ],
)
def test_the_ways_to_write_a_file(tmp_path, content):
    (tmp_path / "rig.yaml").write_text(content)
    assert Model.load(tmp_path / "rig.yaml") == Model.create({"mass": 10.0}, {"viscous_drag": {"coefficient": 2.5}})


def single_values(declared):
    """Values in a parameter's range, its ends among them."""
    return st.floats(declared.low, declared.high)


def names_of(item):
    return (
        st.sampled_from(["heave", "gap_left", "sway_acceleration"]).map(lambda c: f"{item.name}:{c}")
        if item.of_channel
        else st.just(item.name)
    )


SIMPLE = [e for e in catalogue().values() if not any(p.count > 1 for p in e.parameters.values())]
ONE_EFFECT = st.sampled_from(SIMPLE).flatmap(
    lambda item: st.tuples(
        names_of(item), st.fixed_dictionaries({}, optional={p: single_values(d) for p, d in item.parameters.items()})
    )
)
MODELS = st.fixed_dictionaries(
    {
        "parameters": st.fixed_dictionaries({}, optional={n: single_values(p) for n, p in PARAMETERS.items()}),
        "effects": st.lists(ONE_EFFECT, max_size=4).map(dict),
        "dof": st.sampled_from([1, 2, 4]),
    }
)


@settings(QUICK, max_examples=60)
@given(arguments=MODELS)
@example({"parameters": {}, "effects": {"drive_back_emf": {}, "skin_effect": {"corner_frequency": math.inf}}, "dof": 4})
@example(
    {
        "parameters": {},
        "effects": {"sensor_delay:heave": {"delay": 1e-3}, "sensor_bias:gap_left": {"bias": 1e-5}},
        "dof": 2,
    }
)
def test_round_trip(tmp_path, arguments):
    """save → load gives the same model to the last bit, effects in their order, infinite values and sensors' faults
    too."""
    model = Model.create(**arguments)
    model.save(tmp_path / "saved.yaml", comment="a remark\nof two lines: [")
    loaded = Model.load(tmp_path / "saved.yaml")
    assert loaded == model
    assert list(loaded.effects) == list(model.effects)
    assert Model.from_mapping(model.to_mapping()) == model


def test_a_table_comes_back(tmp_path):
    tables = [(e, p) for e in catalogue().values() for p, d in e.parameters.items() if d.count > 1]
    for item, parameter in tables:
        model = Model.create(effects={item.name: {parameter: [1.0, 2.0, -3.0]}})
        model.save(tmp_path / "saved.yaml")
        assert Model.load(tmp_path / "saved.yaml") == model


def test_save_is_what_ros_reads(tmp_path):
    """One block for any node; every number a float, every list typed by its entries (ROS refuses an empty one)."""
    Model.create(effects={"drive_back_emf": {}}).save(tmp_path / "a.yaml")
    Model.default().save(tmp_path / "b.yaml")
    block = yaml.safe_load((tmp_path / "a.yaml").read_text())["/**"]["ros__parameters"]
    assert block["drive_back_emf"]["cutoff_speed"] == math.inf
    assert all(isinstance(block[n], float) for n in PARAMETERS)
    assert "effects" not in yaml.safe_load((tmp_path / "b.yaml").read_text())["/**"]["ros__parameters"]
    assert [f.name for f in tmp_path.iterdir() if f.suffix != ".yaml"] == []  # nothing half-written is left


# -- calls ----------------------------------------------------------------------------------------------------------


def test_a_state_of_the_wrong_length_is_refused():
    """The compiled code checks no bounds: it would read and write beyond the array."""
    model = Model.default()
    whole = len(model.kernel.states)
    for length in (0, 7, 9, whole + 1):
        x = np.zeros(length)
        for call in (
            lambda x: model.simulate([0.0, 1.0], x),
            lambda x: model.advance(x, 0.0, 1.0),
            model.quantities,
            model.wrenches,
        ):
            with pytest.raises(InputError, match="a state has 8 entries"):
                call(x)
    assert model.advance(np.zeros(8), 0.0, 1e-3).shape == (whole,)


@pytest.mark.parametrize("times", [[], [1.0, 0.5], [[0.0, 1.0]], [0.0, np.nan], [0.0, np.inf]])
def test_times_must_rise(times):
    with pytest.raises(InputError, match="times must be a rising list"):
        Model.default().simulate(np.array(times), np.zeros(8))


@pytest.mark.parametrize(
    ("given_state", "message"),
    [
        ({"surge_rat": 1.0}, "did you mean 'surge_rate'"),
        ({"heave": np.nan}, "heave = nan"),
        ({"heave": "low"}, "heave = 'low'"),
        ({"heave": None}, "None"),
    ],
)
def test_initial_state(given_state, message):
    with pytest.raises(InputError, match=message):
        Model.default().initial_state(**given_state)


def test_no_equilibrium_is_told():
    with pytest.raises(InputError, match="nothing carries the cradle"):
        Model.create({"mass": 1e5, "contact_stiffness": 1e3}).initial_state(surge_rate=1.0)
    with pytest.raises(InputError, match="lift exceeds the weight"):
        weak = {"contact_stiffness": 1e3, "width_side": 0.0}
        Model.create(weak, {"aerodynamic_lift": {"lift_area": 10.0}}).initial_state(surge_rate=60.0)


def test_a_run_that_leaves_all_bounds_ends_in_nan():
    """Nothing raises and nothing hangs: the rows after it are NaN, those before are kept."""
    model = Model.create(effects={"magnet_warming": {"rate": 1.0}, "heave_damping": {}})
    x = model.initial_state(surge_rate=20.0)
    x[4] = 1e308
    run = model.simulate(np.linspace(0.0, 1.0, 11), x)
    assert np.isfinite(run.outputs[0, :8]).all()
    assert np.isnan(run.outputs[-1]).all()


def test_a_model_does_not_change():
    model = Model.default()
    with pytest.raises(dataclasses.FrozenInstanceError):
        model.dof = 2
    heavier = model.with_changes({"mass": 12.0})
    assert model.parameters["mass"] == 9.3
    assert heavier.parameters["mass"] == 12.0
    x = model.initial_state(surge_rate=20.0)
    before = x.copy()
    model.simulate([0.0, 0.1], x)
    model.advance(x, 0.0, 0.1)
    assert np.array_equal(x, before)


def test_pulses_may_come_in_any_order():
    model = Model.create(drive="pulses")
    x = model.initial_state(surge_rate=16.0)
    forward = Pulses(np.array([0.0, 0.01, 0.02]), np.array([0, 3, 6]), np.array([7e3, -7e3, 7e3]))
    backward = Pulses(*(getattr(forward, f)[::-1] for f in ("times", "coils", "currents")))
    runs = [model.simulate([0.0, 0.05], x, pulses=p).states[-1] for p in (forward, backward)]
    assert np.array_equal(*runs)
