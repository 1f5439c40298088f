# SPDX-License-Identifier: Apache-2.0
"""`model.yaml` carries how well its parameters are known, and whoever does not ask for that reads the same model."""

import json
import subprocess
import sys

import numpy as np
import pytest
from conftest import LONG

from inductrack_ros import cli
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.core.uncertainty import BLOCK, Uncertainty
from inductrack_ros.estimation.structure import Fitted, Structure

KNOWN = Uncertainty(("eta", "gamma"), np.array([[4e-6, -1e-5], [-1e-5, 9e-4]]))


def saved(tmp_path, known=KNOWN):
    path = tmp_path / "model.yaml"
    Model.default().with_changes({"eta": 0.7}).save(path, "as fitted", known)
    return path


def test_it_comes_back_and_the_model_is_the_same(tmp_path):
    path = saved(tmp_path)
    back = Uncertainty.load(path)
    assert back.names == KNOWN.names and np.array_equal(back.covariance, KNOWN.covariance)
    assert back.std == pytest.approx({"eta": 2e-3, "gamma": 3e-2})
    assert Model.load(path) == Model.default().with_changes({"eta": 0.7})
    Model.default().save(tmp_path / "plain.yaml")
    assert Uncertainty.load(tmp_path / "plain.yaml") is None


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("- gamma", "- eta", "parameters must be a list of different names"),
        ("- 0.0009", "- -0.0009", "covariance is not one"),
        ("- 0.0009", "- much", "must list 2 × 2 numbers"),
        ("  - 0.0009\n", "", "must list 2 × 2 numbers"),
    ],
)
def test_what_is_no_covariance_is_refused(tmp_path, old, new, said):
    path = saved(tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=said) as told:
        Uncertainty.load(path)
    assert BLOCK in str(told.value) and "model.yaml" in str(told.value)


def test_a_node_loads_it(tmp_path):
    """The real parser of ROS 2, through the overrides that every node of ours goes through."""
    pytest.importorskip("rclpy")
    program = (
        "import sys, rclpy\nfrom inductrack_ros.nodes.overrides import readable\nwith readable(sys.argv) as (given,"
        " found):\n    rclpy.init(args=given)\n    node = rclpy.create_node('sim', namespace='/inductrack',"
        " automatically_declare_parameters_from_overrides=True)\n    print(node.get_parameter('eta').value,"
        " found.remarks('/inductrack/sim'), node.has_parameter('covariance'))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, "--ros-args", "--params-file", str(saved(tmp_path))],
        capture_output=True,
        text=True,
        timeout=LONG,
    )
    assert done.stdout.split("\n")[0] == "0.7 [] False", done.stdout + done.stderr


def test_fit_writes_the_covariance_that_it_tells(tmp_path):
    model = Model.default()
    lines = ["initial_speed,travel"]
    for speed in (14.0, 16.0, 20.0, 30.0, 40.0):
        run = model.simulate(np.array([0.0, 2.0]), model.initial_state(surge_rate=speed))
        lines.append(f"{speed},{run['surge'][-1]:.4f}")
    (tmp_path / "travels.csv").write_text("\n".join(lines) + "\n")
    assert cli.main(["fit", str(tmp_path / "travels.csv"), "--std", "0.05", "--output", str(tmp_path / "fit")]) == 0
    told = json.loads((tmp_path / "fit" / "fit.json").read_text())
    known = Uncertainty.load(tmp_path / "fit" / "model.yaml")
    assert known.names == ("eta", "gamma")
    assert known.std == pytest.approx({n: p["std"] for n, p in told["parameters"].items()})
    std = np.array(list(known.std.values()))
    assert known.covariance / np.outer(std, std) == pytest.approx(np.array(told["correlation"]))


class Found(Fitted):
    """A fit of two parameters that go together."""

    def __init__(self, structure, std):
        self.structure, self.theta = structure, structure.start
        self.covariance = np.outer(std, std) * np.array([[1.0, 0.5], [0.5, 1.0]])


def test_a_parameter_that_is_fitted_as_its_inverse_turns_its_correlations_round():
    inverse = "drive_back_emf.cutoff_speed"
    structure = Structure(Model.create(effects={"drive_back_emf": {"cutoff_speed": 300.0}}), ("eta", inverse))
    known = Found(structure, [0.01, 0.02]).uncertainty
    assert known.names == ("eta", inverse)
    correlation = known.covariance[0, 1] / np.sqrt(known.covariance[0, 0] * known.covariance[1, 1])
    assert correlation == pytest.approx(-0.5)
    assert known.std == pytest.approx(Found(structure, [0.01, 0.02]).deviations)
