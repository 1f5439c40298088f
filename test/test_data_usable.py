"""A model is held against runs whose clock can be so and that hold more than their freedom."""

import numpy as np
import pytest

from inductrack_ros import cli
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign, usable, write_csv

TIMES = np.arange(60) / 250


def rig(tmp_path, times, header=None):
    write_csv(tmp_path / "run.csv", times, {c: np.zeros(len(times)) for c in ("surge", "heave")}, overwrite=True)
    if header:
        text = (tmp_path / "run.csv").read_text()
        (tmp_path / "run.csv").write_text(text.replace("time", header, 1))
    (tmp_path / "campaign.yaml").write_text("runs: [{file: run.csv, drive_current: 0}]\n")
    return load_campaign(tmp_path)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "µs"), (1e9, "ns")])
def test_a_clock_in_another_unit(tmp_path, factor, unit):
    model = Model.default()
    with pytest.raises(InputError, match=rf"time is in seconds: this run would last .* if it was written in {unit}, name"):
        usable(rig(tmp_path, TIMES * factor), model)
    read = usable(rig(tmp_path, TIMES * factor, f"time [{unit}]"), model).runs[0]
    assert read.times == pytest.approx(TIMES)


def test_a_slow_logger_says_so(tmp_path):
    usable(rig(tmp_path, TIMES * 250, "time [s]"), Model.default())
    with pytest.raises(InputError, match=r"if it is right, name it 'time \[s\]'"):
        usable(rig(tmp_path, TIMES * 250), Model.default())


def test_a_clock_that_jumps(tmp_path):
    with pytest.raises(InputError, match="the clock jumps by 3600 s between samples 30 and 31 of 60"):
        usable(rig(tmp_path, TIMES + 3600.0 * (np.arange(60) >= 30)), Model.default())
    usable(rig(tmp_path, TIMES + 2.0 * (np.arange(60) >= 30)), Model.default())  # a gap is no jump


def test_no_verdict_from_as_many_values_as_freedom(tmp_path, capsys):
    rig(tmp_path, TIMES)
    write_csv(tmp_path / "short.csv", [0, 0.004], {c: [0.0, 0.1] for c in ("surge", "sway", "heave", "roll")})
    entry = "{file: short.csv, drive_current: 0}"
    (tmp_path / "campaign.yaml").write_text(f"runs: [{{file: run.csv, drive_current: 0}}, {entry}]\n")
    campaign = usable(load_campaign(tmp_path), Model.default())
    assert [r.name for r in campaign.runs] == ["run"]
    assert campaign.notes[0].startswith("short left out: 8 measured values say nothing beside 8 free initial states")
    (tmp_path / "campaign.yaml").write_text(f"runs: [{entry}]\n")
    assert cli.main(["compare", str(tmp_path), "--output", str(tmp_path / "out")]) == 2
    assert "short: 8 measured values say nothing" in capsys.readouterr().err and not (tmp_path / "out").exists()
    whole = entry.replace("}", ", initial_state: {surge: 0, sway: 0, heave: 0, roll: 0}}")
    (tmp_path / "campaign.yaml").write_text(f"runs: [{whole}]\n")
    assert usable(load_campaign(tmp_path), Model.default()).notes == ()
