# SPDX-License-Identifier: Apache-2.0
"""A diagnosis whose time is used up: the best answer so far, and nothing more is begun."""

import time
from types import SimpleNamespace

from test_diagnosis_input import simulated

from inductrack_ros.core.model import Model
from inductrack_ros.diagnosis import moves
from inductrack_ros.diagnosis.diagnose import diagnose
from inductrack_ros.diagnosis.result import OUT_OF_TIME


def rig():
    return simulated([18.0, 24.0, 30.0], model=Model.create(effects={"aerodynamic_drag": {"drag_area": 0.06}}))


def test_no_time_at_all_leaves_the_model_as_it_is_fitted():
    heard = []
    found = diagnose(rig(), Model.default(), heard.append, budget=0.0)
    assert found.effects == () and found.verdict == "unknown_effect" and OUT_OF_TIME in found.notes
    assert found.next_experiment is None and len(found.steps) == 1
    assert heard == ["fitting what is known", "how well it predicts runs left out"]


def test_what_was_found_until_then_is_kept(monkeypatch):
    """The time ends when the search begins to ask for rivals."""
    heard = []
    late = lambda: time.monotonic() + 1e9 * any("in another's place" in line for line in heard)  # noqa: E731
    monkeypatch.setattr(moves, "time", SimpleNamespace(monotonic=late))
    found = diagnose(rig(), Model.default(), heard.append, budget=1e6)
    assert found.effects == ("aerodynamic_drag",) and OUT_OF_TIME in found.notes
    assert [s.effects for s in found.steps] == [(), ("aerodynamic_drag",)]
    assert heard[-1] == "how well it predicts runs left out" and found.laws is None
