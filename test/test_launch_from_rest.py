# SPDX-License-Identifier: Apache-2.0
"""One run from rest to rest: by the model, and by the node as docs/launch_from_rest.md tells it."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import counted, newest_in
from geometry_msgs.msg import PoseStamped, TwistStamped

from inductrack_ros.core.model import Model
from inductrack_ros.data import read_bag
from inductrack_ros.nodes.topics import nanoseconds_of

ROOT = Path(__file__).parents[1]
FILE = ROOT / "config" / "launch_from_rest.yaml"


@pytest.fixture(scope="module")
def flown():
    model, times = Model.load(FILE), np.linspace(0.0, 3.4, 3401)
    return times, model.simulate(times, model.initial_state())


def test_it_stands_floats_lands_and_stands(flown):
    times, run = flown
    gap, speed = run["gap_top"], run["surge_rate"]
    assert gap[0] == pytest.approx(3e-3 - 9.3 * 9.81 / 2e5, abs=1e-9) and speed[0] == 0.0
    afloat = times[gap > 3e-3]
    assert (0.1, 1.3) < (afloat[0], afloat[-1]) < (0.13, 1.5)
    assert np.ptp(afloat) > 0.99 * np.count_nonzero(gap > 3e-3) * 1e-3  # up once; down, with a bounce
    assert gap.min() > 2e-3  # the magnets never touch the track
    assert 20.0 < speed.max() < 27.0 and speed[-1] == 0.0
    assert run["heave"][-1] == pytest.approx(run["heave"][0], abs=1e-9)


def test_energy_of_the_launch(flown):
    """What bungee and drive gave is what drag took: the cradle ends as it began."""
    times, run = flown
    model = Model.load(FILE)
    x = np.zeros((len(times), len(model.kernel.states)))
    x[:, :8] = run.states
    power = np.array(
        [[w[n] @ s[4:8] for n in ("total",)] for s, w in ((s, model.wrenches(s, origin=0.0)) for s in x[::10])]
    )[:, 0]
    assert np.trapezoid(power, times[::10]) == pytest.approx(0.0, abs=0.02 * 0.5 * 300.0 * 4.0**2)


def test_the_bag_in_examples_is_such_a_run(flown):
    """Recorded from the node over DDS: what the model says at every stamp."""
    times, run = flown
    bag = read_bag(ROOT / "examples" / "launch_from_rest")
    for channel in ("surge", "heave", "surge_rate"):
        t, values = bag.samples(channel)
        expected = np.interp(t, times, run[channel])
        noise = {"surge": 5e-4, "heave": 3e-5, "surge_rate": 0.02}[channel]  # of the node's sensors
        assert np.std(values - expected) < 1.5 * noise and t[-1] > 3.0


def test_the_node_flies_it(ros, tmp_path):
    recorder = ros.start("record", "-o", str(tmp_path / "bag"))
    twist, _ = ros.listen(TwistStamped, "/inductrack/twist"), ros.listen(PoseStamped, "/inductrack/pose")
    fast = counted(twist, lambda m: m.twist.linear.x > 20.0)
    ros.start("sim", "--ros-args", "--params-file", str(FILE), "-p", "listeners:=2", "-p", "speed_factor:=3.0")
    # It stands still before the flight too.
    ros.wait(lambda: fast() and twist[-1].twist.linear.x == 0.0, "the end of the run")
    stands = nanoseconds_of(twist[-1].header.stamp)
    ros.wait(lambda: newest_in(tmp_path / "bag").get("/inductrack/measured/twist", 0) > stands, "all of it in the bag")
    assert recorder.stop() == 0
    speed = read_bag(tmp_path / "bag").samples("surge_rate")[1]
    assert abs(speed[0]) < 1.0 and speed.max() > 20.0 and abs(speed[-1]) < 0.2


def test_the_launch_file_names_what_is_there():
    text = (ROOT / "launch" / "launch_from_rest.launch.py").read_text()
    compile(text, "launch_from_rest.launch.py", "exec")
    assert '"launch_from_rest.yaml"' in text and (ROOT / "launch" / "inductrack.launch.py").exists()
    assert "/**" in yaml.safe_load(FILE.read_text())
