# SPDX-License-Identifier: Apache-2.0
"""A user's own effect: one file, used by its name; an edit anywhere in it shows; a mistake in it is told in one line.

Idea: compiled code is cached on disk, and a cache that misses an edit gives wrong physics without a word. So each way
an answer can change (the effect, a function it calls, a constant, another process) is edited here and asked again.
All but the example compile the effect alone and only the part that is called, which takes a second instead of ten.
"""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from inductrack_ros.core import compiled, kernel
from inductrack_ros.core import effects as effects_package
from inductrack_ros.core.effects import catalogue
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model

ROOT = Path(__file__).parents[1]
STATE = [2.0, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0]

SOURCE = """
import math
from numba import njit
from inductrack_ros.core.effects import Parameter, effect

STRENGTH = 2.0
TABLE = (1.0, 10.0)

def shape(z):
    return STRENGTH * inner(z)

def inner(z):
    return math.sin(z)

def make(power):
    @njit
    def raised(z):
        return z ** power
    return raised

square = make(2.0)

@effect(adds="force_heave", parameters={"force": Parameter(0.0, "N", -10.0, 10.0, "size")})
def bump(surge, force):
    return force * shape(surge) + square(surge) + TABLE[1]
"""
ANSWER = 3.0 * 2.0 * math.sin(2.0) + 4.0 + 10.0


@pytest.fixture
def alone(monkeypatch, tmp_path):
    """Only the user's effects are known, and only what is called is compiled."""
    monkeypatch.setenv("INDUCTRACK_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(effects_package, "_catalogue", dict)
    monkeypatch.setattr(kernel, "_warm_up", lambda kernel: None)
    return tmp_path / "mine.py"


def bump(path):
    """The effect's force in heave at 2 m."""
    return Model.create(effects={"bump": {"force": 3.0}}, effect_files=[path]).wrenches(STATE)["bump"][2]


# -- it works -------------------------------------------------------------------------------------------------------


def test_the_example(tmp_path):
    """By name from the model's YAML, among the whole catalogue, in a run: pulled down as it passes 8 m."""
    (tmp_path / "my_effect.py").write_text((ROOT / "examples" / "my_effect.py").read_text())
    text = "effect_files: [my_effect.py]\neffects: [magnetised_patch, viscous_drag]\nmagnetised_patch: {force: 3.0}\n"
    (tmp_path / "model.yaml").write_text(text)
    model = Model.load(tmp_path / "model.yaml")
    force = model.wrenches([8.3, *STATE[1:]])["magnetised_patch"]
    assert force == pytest.approx([0, 0, -3.0 * math.exp(-0.36), 0])

    times = np.linspace(0.0, 0.6, 301)
    plain = Model.default()
    start = plain.initial_state(surge_rate=20.0)
    lower = model.simulate(times, start)["heave"] - plain.simulate(times, start)["heave"]
    assert np.abs(lower[times * 20 < 6]).max() < 1e-6
    assert lower[np.searchsorted(times * 20, 8.2)] < -1e-5

    model.save(tmp_path / "elsewhere.yaml")
    assert Model.load(tmp_path / "elsewhere.yaml") == model


def test_a_user_effect_may_carry_a_state(alone):
    alone.write_text("""
from inductrack_ros.core.effects import effect

@effect(changes="thrust", states={"lagging": "thrust"})
def sluggish(thrust, lagging):
    return lagging, (thrust - lagging) / 0.05
""")
    model = Model.create(effects=["sluggish"], effect_files=[alone])
    x = model.with_effect_states(model.initial_state(surge_rate=20.0))
    assert len(x) == 9
    assert model.quantities(x, drive_current=7000.0)["thrust"] == pytest.approx(x[8])
    assert x[8] == pytest.approx(model.with_changes(effects={}).quantities(x)["thrust"])


def test_a_state_starts_on_anything_or_on_a_number(alone):
    """A quantity that no output shows, a parameter, a state of the cradle, a number."""
    alone.write_text("""
from inductrack_ros.core.effects import effect

@effect(changes="thrust", states={"a": "omega", "b": "air_density", "c": "heave", "d": -2.5, "e": "zero", "f": "mass"})
def recalls(thrust, a, b, c, d, e, f):
    return thrust, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
""")
    model = Model.create({"mass": 7.0}, effects=["recalls"], effect_files=[alone])
    x = model.with_effect_states([1.0, 0.0, -0.004, 0.0, 20.0, 0.0, 0.0, 0.0])
    assert x[8:].tolist() == pytest.approx([2 * math.pi / 0.1 * 20.0, 1.29, -0.004, -2.5, 0.0, 7.0])


def test_an_effect_may_add_and_change(alone):
    """One function for both: what it adds comes first, and is added where the forces are summed up."""
    alone.write_text("""
from inductrack_ros.core.effects import Parameter, effect

@effect(adds=("force_surge", "force_heave"), changes="resistance", parameters={"c": Parameter(0.0, "", 0.0, 10.0, "size")})
def warm_and_draughty(resistance, surge_rate, c):
    return -c * surge_rate, 2.0 * c, resistance * (1.0 + c)
""")  # noqa: E501
    model = Model.create({}, {"warm_and_draughty": {"c": 0.5}}, effect_files=[alone])
    total = model.wrenches(STATE)["total"]
    apart = model.with_changes({"resistance": 1.5 * 1.5e-3}, {}).wrenches(STATE)["total"]
    assert total == pytest.approx(apart + [-0.5 * 20.0, 0.0, 1.0, 0.0], rel=1e-12)


def test_a_second_function_sees_the_sum_of_all_forces(alone):
    """Also what effects behind it in the alphabet add."""
    alone.write_text("""
from inductrack_ros.core.effects import Part, effect

def half(force_heave, kept):
    return 0.5 * force_heave, force_heave - kept

@effect(changes="gap_top", then=Part(half, changes=("force_heave",)), states={"kept": 0.0})
def a_frame(gap_top):
    return gap_top

@effect(adds="force_heave")
def b_push(mass):
    return 10.0 * mass
""")
    model = Model.create(effects=["a_frame", "b_push"], effect_files=[alone])
    plain = model.with_changes(effects={}).wrenches(STATE)["total"][2]
    full = model.with_effect_states(STATE)
    full[8] = 3.0
    assert model.wrenches(full)["total"][2] == pytest.approx(0.5 * (plain + 93.0))
    assert model._evaluate(0.0, full, model.vector, model.switches)[0][8] == pytest.approx(plain + 93.0 - 3.0)


def test_the_states_of_effects_are_under_the_error_control(alone):
    """An oscillator of 300 Hz that pushes the cradle: without a bound on the step it is followed to a part in 10⁵."""
    alone.write_text("""
from inductrack_ros.core.effects import effect

@effect(adds="force_sway", states={"a": 1.0, "b": 0.0})
def rattle(a, b):
    return 0.0 * a, 1885.0 * b, -1885.0 * a
""")
    model = Model.create(effects=["rattle"], effect_files=[alone])
    x = model.advance(model.with_effect_states(model.initial_state(surge_rate=20.0)), 0.0, 0.05)
    assert x[8:] == pytest.approx([math.cos(1885.0 * 0.05), -math.sin(1885.0 * 0.05)], abs=2e-3)


# -- an edit shows --------------------------------------------------------------------------------------------------


def test_an_edit_shows(alone):
    """The same process, the same file, a new answer; and the first again when the edit is undone."""
    alone.write_text(SOURCE)
    assert bump(alone) == pytest.approx(ANSWER)
    alone.write_text(SOURCE.replace("STRENGTH = 2.0", "STRENGTH = 5.0"))  # a constant of a function the effect calls
    assert bump(alone) == pytest.approx(15.0 * math.sin(2.0) + 14.0)
    alone.write_text(SOURCE)
    assert bump(alone) == pytest.approx(ANSWER)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("return force * shape", "return 2.0 * force * shape"),  # the effect itself
        ("math.sin(z)", "math.cos(z)"),  # a function called by a function it calls
        ("STRENGTH = 2.0", "STRENGTH = 5.0"),
        ("TABLE = (1.0, 10.0)", "TABLE = (1.0, 20.0)"),
        ("make(2.0)", "make(3.0)"),  # what a closure holds
        ("z ** power", "z * power"),
    ],
)
def test_every_edit_is_another_kernel(alone, old, new):
    """What compiled code is kept under changes with each; compiling them all would take a minute."""

    def key(source):
        alone.write_text(source)
        return compiled.fingerprint(effects_package.load_effects([alone])["bump"].function, set())

    assert SOURCE.count(old) == 1
    assert key(SOURCE) != key(SOURCE.replace(old, new))
    assert key(SOURCE) == key("# a remark, which is no edit\n" + SOURCE)


def test_another_process_takes_the_cache_and_sees_edits(alone):
    """The second process does not compile again what the first left; after an edit it does."""
    script = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import test_core_user_effects as t
from inductrack_ros.core import effects, kernel
effects._catalogue = dict
kernel._warm_up = lambda kernel: None
print(t.bump({str(alone)!r}))
"""

    def ask():
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)
        return float(done.stdout), "compiling" in done.stderr

    source = SOURCE.replace("STRENGTH = 2.0", "STRENGTH = 7.0")  # of no other test, whose kernel is in memory still
    alone.write_text(source)
    assert bump(alone) == pytest.approx(21.0 * math.sin(2.0) + 14.0)
    alone.write_text("# a remark, which is no edit\n" + source)
    value, compiled = ask()
    assert value == pytest.approx(21.0 * math.sin(2.0) + 14.0)
    assert not compiled
    alone.write_text(source.replace("math.sin(z)", "math.cos(z)"))
    value, compiled = ask()
    assert value == pytest.approx(21.0 * math.cos(2.0) + 14.0)
    assert compiled


def test_a_damaged_cache_is_made_anew(tmp_path, monkeypatch):
    """Half a file left by a full disk is thrown away, not shown to the user."""
    monkeypatch.setenv("INDUCTRACK_CACHE", str(tmp_path))
    monkeypatch.setattr(effects_package, "_catalogue", dict)
    calls = []

    def warm_up(built):  # the real one takes ten seconds
        calls.append(len(list(tmp_path.glob("*/__pycache__/*.nbc"))))
        if len(calls) == 1:
            folder = Path(sys.modules[built.evaluate.__module__].__file__).parent / "__pycache__"
            folder.mkdir(exist_ok=True)
            (folder / "damaged.nbc").write_bytes(b"")
        if calls[-1]:
            raise EOFError("ran out of input")

    monkeypatch.setattr(kernel, "_warm_up", warm_up)
    path = tmp_path / "mine.py"
    path.write_text(SOURCE.replace("STRENGTH = 2.0", "STRENGTH = 8.0"))
    _ = Model.create(effect_files=[path]).kernel
    monkeypatch.setattr(compiled, "_modules", {})
    monkeypatch.setattr(kernel, "_built", {})
    _ = Model.create(effect_files=[path]).kernel
    assert calls == [0, 1, 0]


def test_a_function_of_another_module_counts_too(tmp_path, monkeypatch):
    """Of an imported module, what the effect uses is part of what the cache is kept under."""
    monkeypatch.syspath_prepend(tmp_path)
    source = "import {m}\nfrom {m} import inner\ndef outer(v):\n    return inner(v) + {m}.other(v)\n"
    prints = set()
    for number, (inner, other) in enumerate([("v", "v"), ("2*v", "v"), ("v", "2*v"), ("v", "v")]):
        module = f"inductrack_test_helper_{number}"
        (tmp_path / f"{module}.py").write_text(
            f"def inner(v):\n    return {inner}\ndef other(v):\n    return {other}\n"
        )
        scope = {}
        exec(source.format(m=module), scope)
        prints.add(compiled.fingerprint(scope["outer"], set()).replace(module, ""))
    assert len(prints) == 3


# -- a mistake is told ----------------------------------------------------------------------------------------------

HEAD = "import math\nfrom inductrack_ros.core.effects import Parameter, Part, effect\n"
WHEN_LOADED = {
    "syntax error": ("def broken(:\n    pass\n", r"line 3: SyntaxError: invalid syntax"),
    "fails when run": ("one = 1\nvalue = {}['x']\n", r"line 4: KeyError: 'x'"),
    "ends the program": ("raise SystemExit(3)\n", r"line 3: SystemExit: 3"),
    "many lines": ("raise ValueError('one\\ntwo')\n", r"line 3: ValueError: one$"),
    "no effect": ("def plain(surge):\n    return 1.0\n", "no @effect function"),
    "catalogue's name": (
        '@effect(adds="force_surge")\ndef viscous_drag(surge):\n    return 1.0\n',
        "'viscous_drag' is in the catalogue",
    ),
    "no such force": (
        '@effect(adds="force_up")\ndef mine(surge):\n    return 1.0\n',
        "adds to 'force_up'.*force_heave",
    ),
    "neither": ("@effect()\ndef mine(surge):\n    return 1.0\n", "say adds=.*changes="),
    "not declared": (
        '@effect(adds="force_surge", parameters={"c": 1.0})\ndef mine(c):\n    return c\n',
        r"declare 'c' as Parameter\(",
    ),
    "not taken": (
        '@effect(adds="force_surge", parameters={"c": Parameter(0, "", 0, 1, "")})\ndef mine(surge):\n    return 1.0\n',
        "declares parameter 'c' but its function does not take it",
    ),
    "no such option": (
        '@effect(adds="force_surge", max_steps=1.0)\ndef mine(surge):\n    return 1.0\n',
        "takes no 'max_steps'; did you mean 'max_step'",
    ),
    "no start": (
        '@effect(adds="force_surge", states={"s": None})\ndef mine(s):\n    return 1.0, s\n',
        "state 's' starts on None; give a number or",
    ),
    "star": ('@effect(adds="force_surge")\ndef mine(*all):\n    return 1.0\n', "'all' is not a plain argument"),
}


@pytest.mark.parametrize("mistake", WHEN_LOADED)
def test_mistakes_found_when_loaded(tmp_path, mistake):
    source, message = WHEN_LOADED[mistake]
    path = tmp_path / "mine.py"
    path.write_text(HEAD + source)
    with pytest.raises(InputError, match=message) as caught:
        Model.create(effect_files=[path])
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00", b"x = '\x00'"])
def test_files_that_are_no_python(tmp_path, content):
    path = tmp_path / "mine.py"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match="mine.py"):
        Model.create(effect_files=[path])
    with pytest.raises(InputError, match="cannot be read"):
        Model.create(effect_files=[tmp_path])


def test_two_files_may_not_share_a_name(tmp_path):
    for name in ("one.py", "two.py"):
        (tmp_path / name).write_text(SOURCE)
    with pytest.raises(InputError, match="two.py: 'bump' is in another effect file"):
        Model.create(effect_files=[tmp_path / "one.py", tmp_path / "two.py"])
    assert "bump" in Model.create(effect_files=[tmp_path / "one.py"] * 2).known_effects  # the same twice is no clash


def test_a_catalogue_effect_may_be_imported(tmp_path):
    (tmp_path / "mine.py").write_text("from inductrack_ros.core.effects.viscous_drag import viscous_drag\n" + SOURCE)
    assert set(Model.create(effect_files=[tmp_path / "mine.py"]).known_effects) == {*catalogue(), "bump"}


ADDS = '@effect(adds="force_surge")\n'
WHEN_BUILT = {
    "unknown quantity": (
        ADDS + "def mine(surge_rat):\n    return 1.0\n",
        "asks for 'surge_rat'.*did you mean 'surge_rate'",
    ),
    "known too late": (
        '@effect(changes="resistance")\ndef mine(thrust):\n    return thrust\n',
        "asks for 'thrust'.*not known yet",
    ),
    "changes nothing known": (
        '@effect(changes="resistence")\ndef mine(surge):\n    return 1.0\n',
        "changes 'resistence'.*'resistance'",
    ),
    "unknown start": (
        '@effect(changes="thrust", states={"s": "trust"})\ndef mine(s):\n    return s, s\n',
        "starts on 'trust'.*'thrust'",
    ),
    "no such name": (
        ADDS + "def mine(surge):\n    return surge * lenght\n",
        "cannot be compiled: .*'lenght' is not defined",
    ),
    "a dictionary": (
        'T = {"a": 1.0}\n' + ADDS + 'def mine(surge):\n    return surge + T["a"]\n',
        r"cannot be compiled: .*'T'.*dict.*line 6",
    ),
    "text": (ADDS + 'def mine(surge):\n    return surge + "a"\n', r"cannot be compiled: .*add.*float64.*str.*line 5"),
    "in a helper": (
        "def help(z):\n    return nothing(z)\n" + ADDS + "def mine(surge):\n    return help(surge)\n",
        "cannot be compiled.*nothing",
    ),
    "returns nothing": (ADDS + "def mine(surge):\n    surge + 1.0\n", "does not always return a value.*1: force_surge"),
    "returns sometimes": (
        ADDS + "def mine(surge):\n    if surge > 1.0:\n        return 1.0\n",
        "does not always return a value",
    ),
    "too many": (ADDS + "def mine(surge):\n    return 1.0, 2.0\n", "returns 2 values; it must return 1: force_surge"),
    "too few": (
        '@effect(adds=("force_surge", "force_sway"))\ndef mine(surge):\n    return 1.0\n',
        "returns 1 values?; it must return 2: force_surge, force_sway",
    ),
    "too late": (
        (
            'def f(thrust):\n    return thrust\n@effect(adds="force_surge", then=Part(f, changes=("thrust",)))\ndef'
            " mine(surge):\n    return surge\n"
        ),
        "changes 'thrust' in its second function.*force_surge",
    ),
    "a force at once": (
        '@effect(changes=("thrust", "force_surge"))\ndef mine(thrust, force_surge):\n    return thrust, force_surge\n',
        "change the force in a second function",
    ),
    "no rate": (
        '@effect(changes="thrust", states={"s": "thrust"})\ndef mine(s):\n    return s\n',
        "must return 2: thrust, rate of s",
    ),
    "complex": (ADDS + "def mine(surge):\n    return surge * 1j\n", "not real numbers"),
}


@pytest.mark.parametrize("mistake", WHEN_BUILT)
def test_mistakes_found_when_compiled(alone, mistake):
    """They name the file, the line and the effect, also where the rest of the model compiles."""
    source, message = WHEN_BUILT[mistake]
    alone.write_text(HEAD + source)
    model = Model.create(effect_files=[alone])
    with pytest.raises(InputError, match=message) as caught:
        _ = model.kernel
    assert str(caught.value).startswith(f"{alone}, line ")
    assert "effect 'mine'" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600
    with pytest.raises(InputError, match=message):  # and again, not from a cache of half a model
        _ = Model.create(effect_files=[alone]).kernel
