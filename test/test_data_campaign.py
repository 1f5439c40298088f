# SPDX-License-Identifier: Apache-2.0
"""campaign.yaml: what it may say, and one broken campaign per way to break one."""

import os

import numpy as np
import pytest

from inductrack_ros.core.errors import InputError
from inductrack_ros.core.state import STATES
from inductrack_ros.data import Pulses, load_campaign, write_bag, write_csv

RUNS = "runs:\n- {file: run_00.csv, drive_current: 7000.0}\n"


@pytest.fixture
def folder(tmp_path):
    """A rig with two CSV runs, one bag and one bag that holds its pulses."""
    rig = tmp_path / "rig"
    rig.mkdir()
    for name in ("run_00", "run_01"):
        write_csv(rig / f"{name}.csv", [0.0, 0.1], {"surge": [0.0, 1.5], "heave": [-0.005, -0.004]})
    states = dict.fromkeys(STATES, np.zeros(2))
    write_bag(rig / "coast", [0.0, 0.1], states)
    write_bag(rig / "launch", [0.0, 0.1], states, pulses=Pulses(np.zeros(1), np.array([3]), np.array([7000.0])))
    (rig / "rig.yaml").write_text("eta: 0.7\n")
    for name in ("run #1.csv", "la\u0308uft.csv"):  # the ä as macOS writes it
        (rig / name).write_text("time,surge,heave\n0,0,-0.005\n0.1,1.5,-0.004\n")
    return rig


def load(folder, text):
    (folder / "campaign.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    return load_campaign(folder)


# ---------------------------------------------------------------- what it may say


def test_everything_at_once(folder):
    campaign = load(
        folder,
        """
name: rig-2026-10
noise_std: {surge: 5.0e-4, heave: 3e-5}   # YAML 1.1 takes the second for text; people do not
topics: {twist: null}
model: rig.yaml
free: [eta]
dof: 2
runs:
- {file: run_00.csv, drive_current: 7000}
- {file: coast, drive_current: 0.0}
- {file: run_01.csv, drive_current: -3.5e3, initial_state: {surge_rate: 20.0, heave: -0.0047}}
- file: launch
""",
    )
    assert campaign.name == "rig-2026-10"
    assert campaign.folder == folder
    assert campaign.noise_std == {"surge": 5e-4, "heave": 3e-5}
    assert campaign.model == folder / "rig.yaml"
    assert campaign.free == ("eta",)
    assert campaign.dof == 2
    assert [run.name for run in campaign.runs] == ["run_00", "coast", "run_01", "launch"]
    assert [run.drive_current for run in campaign.runs] == [7000.0, 0.0, -3500.0, 0.0]
    assert campaign.runs[2].initial_state == {"surge_rate": 20.0, "heave": -0.0047}
    assert campaign.channels == ("surge", "sway", "heave", "roll")
    assert campaign.runs[3].pulses.coils.tolist() == [3]


def test_nothing_but_runs(folder):
    campaign = load(folder, RUNS)
    assert campaign.name == "rig"
    assert campaign.noise_std == {}
    assert campaign.model is None
    assert campaign.free == ("eta", "gamma")
    assert campaign.dof is None
    assert campaign.runs[0].initial_state == {}
    assert campaign.runs[0].channels == ("surge", "heave")


def test_the_file_itself_may_be_named(folder):
    load(folder, RUNS)
    (folder / "campaign.yaml").rename(folder / "other.yaml")
    assert load_campaign(folder / "other.yaml").runs[0].file == folder / "run_00.csv"


def test_an_empty_list_frees_nothing(folder):
    assert load(folder, RUNS + "free: []").free == ()


def test_topics_reach_the_bags(folder):
    with pytest.raises(InputError, match="coast: no topic /rig/pose"):
        load(folder, "topics: {pose: /rig/pose}\nruns: [{file: coast, drive_current: 0}]")


def test_runs_that_share_a_name_get_their_paths(folder):
    (folder / "a").mkdir()
    (folder / "a" / "run_00.csv").write_bytes((folder / "run_00.csv").read_bytes())
    campaign = load(folder, RUNS + "- {file: a/run_00.csv, drive_current: 0}\n- {file: run_01.csv, drive_current: 0}")
    assert [run.name for run in campaign.runs] == ["run_00.csv", "a_run_00.csv", "run_01"]


# ---------------------------------------------------------------- one broken campaign per failure

BROKEN = {
    "empty": ("", "empty; it needs"),
    "only a comment": ("# nothing\n", "empty; it needs"),
    "a list": ("- run_00.csv\n", r"line 1: must be `key: value` lines, not \['run_00.csv'\]"),
    "a word": ("run_00.csv", "must be `key: value` lines"),
    "tabs": ("name: rig\nruns:\n\t- file: run_00.csv\n", "line 3: not valid YAML.*spaces, not tabs"),
    "open bracket": ("name: rig\nruns: [\n", "line 3: not valid YAML"),
    "control character": ("name: rig\nmodel: \0\n", "line 2: not valid YAML: a control character"),
    "not utf-8": ("name: Länge".encode("latin-1"), "not UTF-8"),
    "no such date": ("name: 2026-13-45\n" + RUNS, "not valid YAML"),
    "deep": ("[" * 5000, "not valid YAML"),
    "key twice": (RUNS + RUNS, "line 3: not valid YAML: 'runs' is given twice"),
    "list as key": ("? [a]\n: b\n", "a key must be a word"),
    "unknown key": (RUNS + "noise: {surge: 1}\n", "line 3: unknown key 'noise'; did you mean 'noise_std'"),
    "no runs": ("name: rig\n", "runs must list at least one run"),
    "runs empty": ("runs: []\n", "runs must list at least one run"),
    "runs a word": ("name: rig\nruns: run_00.csv\n", "line 2: runs must list"),
    "run a word": ("runs:\n- run_00.csv\n", r"line 1: runs\[0\]: must be `key: value` lines, not 'run_00.csv'"),
    "no file": ("runs:\n- drive_current: 0\n", r"line 2: runs\[0\]: file must be text, not nothing"),
    "file a number": ("runs:\n- file: 17\n", "file must be text, not 17; put it in quotes"),
    "file missing": (RUNS + "- {file: run_09.csv, drive_current: 0}", r"line 3: runs\[1\]: .*run_09.csv: no such file"),
    "a blank that is none": (
        "name:\u00a0rig\nruns:\n- {file: run_00.csv, drive_current: 0}\n",
        "line 1 holds a blank that is",
    ),
    "a comment in a name": (
        "runs:\n- {file: run #1.csv, drive_current: 0}\n- {file: run_00.csv, drive_current: 0}\n",
        "in line 2, a # behind a blank begins a comment: put the name in quotes",
    ),
    "a name cut off by a comment": ("runs:\n- file: run #1.csv\n  drive_current: 0\n", "a # behind a blank begins a"),
    "a pattern without quotes": (
        "runs:\n- {file: *.csv, drive_current: 0}\n",
        r"in line 2, put what begins with \* in",
    ),
    "a key on its own": (
        "runs:\n- file: run_00.csv\n- drive_current: 0\n",
        r"line 3: runs\[1\]: has no file; where drive_current belongs to the run above it, write it without -",
    ),
    "keys indented otherwise": (
        "runs:\n- file: run_00.csv\n drive_current: 0\n",
        "the keys of one entry must be indented alike",
    ),
    "letters with marks in two ways": (
        "runs:\n- {file: l\u00e4uft.csv, drive_current: 0}\n",
        "a file that looks the same is there",
    ),
    "file too long": (f"runs:\n- file: {'x' * 5000}\n", "no such file"),
    "unknown run key": ("runs:\n- {file: run_00.csv, current: 7000}", r"line 2: runs\[0\]: unknown key 'current'"),
    "duplicate": (RUNS + "- {file: ./run_00.csv, drive_current: 0}", r"line 3: runs\[1\]: .*listed twice"),
    "no current": ("runs:\n- file: run_00.csv\n", r"line 2: runs\[0\]: drive_current of run_00.csv is missing"),
    "current nan": ("runs:\n- {file: run_00.csv, drive_current: .nan}", "drive_current must be finite"),
    "current too large": (
        "runs:\n- {file: run_00.csv, drive_current: 7.0e+6}",
        r"line 2: runs\[0\]: .* 100000 A at most; is it in mA",
    ),
    "current a word": (
        "runs:\n- {file: run_00.csv, drive_current: full}",
        "drive_current must be a number, not 'full'",
    ),
    "current yes": ("runs:\n- {file: run_00.csv, drive_current: yes}", "drive_current must be a number, not True"),
    "current huge": (f"runs:\n- {{file: run_00.csv, drive_current: 1{'0' * 400}}}", "drive_current must be"),
    "initial state unknown": (
        "runs:\n- file: run_00.csv\n  drive_current: 0\n  initial_state: {speed: 1}",
        r"line 4: runs\[0\].initial_state: unknown key 'speed'",
    ),
    "initial state nan": (
        "runs:\n- {file: run_00.csv, drive_current: 0, initial_state: {heave: .inf}}",
        "heave must be finite",
    ),
    "initial state a list": (
        "runs:\n- {file: run_00.csv, drive_current: 0, initial_state: [1]}",
        r"runs\[0\].initial_state: must be `key: value` lines",
    ),
    "noise zero": (RUNS + "noise_std:\n  heave: 0\n", "line 4: noise_std: heave must be above 0; leave it out"),
    "noise negative": (RUNS + "noise_std: {heave: -1.0e-5}\n", "heave must be above 0"),
    "noise nan": (RUNS + "noise_std: {heave: .nan}\n", "heave must be finite"),
    "noise nothing": (RUNS + "noise_std: {heave: }\n", "heave must be a number, not nothing"),
    "noise unknown": (RUNS + "noise_std: {heav: 1.0}\n", "noise_std: unknown key 'heav'; did you mean 'heave'"),
    "topic unknown": (RUNS + "topics: {poses: /x}\n", "topics: unknown key 'poses'; did you mean 'pose'"),
    "topic a number": (RUNS + "topics: {pose: 5}\n", "topics: pose must be text, not 5"),
    "model missing": (RUNS + "model: none.yaml\n", "line 3: model .*none.yaml: no such file"),
    "model a folder": (RUNS + "model: coast\n", "no such file"),
    "free a word": (RUNS + "free: eta\n", r"free must be a list of parameter names, e.g. \[eta, gamma\], not 'eta'"),
    "free numbers": (RUNS + "free: [1]\n", "free must be a list"),
    "free twice": (RUNS + "free: [eta, eta]\n", "free names 'eta' twice"),
    "dof": (RUNS + "dof: 3\n", "dof must be 1, 2, 4 or a list out of surge, sway, heave, roll, not 3"),
    "dof a list": (RUNS + "dof: [4]\n", r"dof must be 1, 2, 4 or a list out of .*, not \[4\]"),
    "dof unknown": (RUNS + "dof: [surge, pitch]\n", "dof must be 1, 2, 4 or a list"),
    "dof twice": (RUNS + "dof: [surge, surge]\n", "dof must be 1, 2, 4 or a list"),
    "dof empty": (RUNS + "dof: []\n", "dof must be 1, 2, 4 or a list"),
    "dof yes": (RUNS + "dof: true\n", "dof must be 1, 2, 4 or a list"),
    "free misspelt": (RUNS + "free: [etta]\n", "free: unknown parameter 'etta'; did you mean 'eta'"),
    "input a number": (RUNS + "inputs: {wind: 3}\n", "inputs: wind must be text, not 3"),
    "condition a word": (
        "runs:\n- {file: run_00.csv, drive_current: 0, conditions: {track_temperature: warm}}",
        r"runs\[0\].conditions: track_temperature must be a number, not 'warm'",
    ),
    "condition out of range": (
        "runs:\n- {file: run_00.csv, drive_current: 0, conditions: {mass: -1}}",
        r"line 2: runs\[0\].conditions: mass = -1 is out of range; it must lie in \[0.001, 100000\] kg",
    ),
    "condition twice": (
        "runs:\n- {file: run_00.csv, drive_current: 0, conditions: {drive_current: 1}}",
        "drive_current stands beside file",
    ),
    "a run's key beside the runs": (
        "runs:\n- file: run_00.csv\ndrive_current: 0\n",
        "line 3: unknown key 'drive_current'; it belongs to a run: indent it",
    ),
    "no blank behind a colon": ("runs:\n- {file:run_00.csv, drive_current: 0}\n", "put a blank behind the colon"),
    "a decimal comma": ("runs:\n- {file: run_00.csv, drive_current: 0,5}\n", "a decimal point, not a comma"),
    "a pattern": ("runs:\n- {file: 'run_*.csv', drive_current: 0}\n", r"not filled in \(run_00.csv, run_01.csv, …\)"),
    "a pattern of nothing": ("runs:\n- {file: 'x*.csv', drive_current: 0}\n", r"\(it matches nothing\); give each run"),
    "a path of Windows": (
        "runs:\n- {file: .\\run_00.csv, drive_current: 0}\n",
        "write / between folders: ./run_00.csv",
    ),
    "a drive of Windows": (
        "runs:\n- {file: 'D:\\a\\run_00.csv', drive_current: 0}\n",
        "a path of Windows; copy the file",
    ),
    "a home": ("runs:\n- {file: ~/run_00.csv, drive_current: 0}\n", "write the path out"),
    "of another machine": ("runs:\n- {file: /no/run_00.csv, drive_current: 0}\n", "write its path on this machine"),
    "other letters": ("runs:\n- {file: Run_00.CSV, drive_current: 0}\n", "no such file; did you mean 'run_00.csv'"),
    "no suffix": ("runs:\n- {file: run_01, drive_current: 0}\n", "no such file; did you mean 'run_01.csv'"),
    "name a list": (RUNS + "name: [a]\n", "name must be text"),
}


@pytest.mark.parametrize(("text", "message"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_campaign_is_one_line_that_names_it(folder, text, message):
    with pytest.raises(InputError, match=message) as caught:
        load(folder, text)
    assert str(folder / "campaign.yaml") in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_pipe_is_not_waited_for(folder):
    os.mkfifo(folder / "pipe.csv")
    with pytest.raises(InputError, match="pipe.csv: not a regular file"):
        load(folder, "runs: [{file: pipe.csv, drive_current: 0}]")


def test_a_broken_run_names_its_own_file(folder):
    (folder / "run_00.csv").write_text("time,heave\n0,1\n")
    with pytest.raises(InputError, match="run_00.csv: 1 row of data"):
        load(folder, RUNS)


def test_what_is_no_campaign(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        load_campaign(tmp_path / "none")
    with pytest.raises(InputError, match="no such file; a campaign is a folder with campaign.yaml"):
        load_campaign(tmp_path)
    (tmp_path / "campaign.yaml").mkdir()
    with pytest.raises(InputError, match="no such file"):
        load_campaign(tmp_path)
    with pytest.raises(InputError):
        load_campaign("a\0b")


@pytest.mark.parametrize("name", ["campaign.yml", "Campaign.yaml", "campaign.yaml.txt"])
def test_a_campaign_under_another_name_is_named(folder, name):
    (folder / name).write_text(RUNS)
    with pytest.raises(InputError, match=f"rename {name}"):
        load_campaign(folder)
