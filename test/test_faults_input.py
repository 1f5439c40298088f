# SPDX-License-Identifier: Apache-2.0
"""Wrong input to nodes and commands as a user gives it, and files of others: one line, exit status 2, nothing run."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

import pytest
from test_compare import make_campaign

from inductrack_ros import cli
from inductrack_ros.core.errors import InputError
from inductrack_ros.core.model import Model
from inductrack_ros.data import load_campaign
from inductrack_ros.nodes import domain, record, runtime
from inductrack_ros.nodes.sim import SimNode

NASTY = "<img src=x onerror=alert(1)>"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A small campaign, and files that are wrong in one way each."""
    made = make_campaign(tmp_path / "rig", Model.default(), duration=0.1)
    (tmp_path / "broken.yaml").write_text("a: [1\n")
    (tmp_path / "mixed.yaml").write_text("/**:\n  ros__parameters: {eta: [1, a]}\n")
    (tmp_path / "pulses.yaml").write_text("drive: pulses\n")
    (tmp_path / "others.yaml").write_text("a: {ros__parameters: {x: 1}}\nb: {ros__parameters: {x: 1}}\n")
    (made / "evil.py").write_text(f"open({str(tmp_path / 'was_run')!r}, 'w')\n")
    (made / "evil.yaml").write_text("effect_files: [evil.py]\n")
    return tmp_path


NODE_INPUTS = {
    "no such file": (["--params-file", "nowhere.yaml"], "nowhere.yaml: no such file"),
    "broken YAML": (["--params-file", "broken.yaml"], "broken.yaml, line 2: not valid YAML"),
    "mixed list": (
        ["--params-file", "mixed.yaml"],
        "mixed.yaml: eta = [1, 'a']: all entries of a list must be of one kind",
    ),
    "no value": (["-p", "eta"], "Couldn't parse parameter override rule: '-p eta'"),
    "no such option": (["--frobnicate"], "--frobnicate"),
    "out of range": (["-p", "mass:=-1.0"], "sim: mass = -1 is out of range; it must lie in [0.001, 100000] kg"),
    "not a number": (["-p", "mass:=.nan"], "sim: mass = nan is out of range"),
    "unknown": (["-p", "speed_facto:=2.0"], "unknown parameter 'speed_facto'; did you mean 'speed_factor'?"),
    "no such speed": (["-p", "initial_state:=surge_rate=1e308"], "nothing carries the cradle at 1e+308 m/s"),
    "bag that exists": ([], "exists already; give another --output or move it away"),
}


@pytest.mark.parametrize("mistake", NODE_INPUTS)
def test_a_node_says_in_one_line_what_is_wrong(folder, monkeypatch, capsys, mistake):
    given, says = NODE_INPUTS[mistake]
    monkeypatch.chdir(folder)
    monkeypatch.setattr(runtime.STOP, "listen", lambda: None)  # the signals of the tests' own process stay theirs
    if mistake == "bag that exists":
        assert record.main(["record", "-o", str(folder)]) == 2
    else:
        assert runtime.run(SimNode, ["sim", "--ros-args", *given]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and said[0].startswith("error: ") and says in said[0]


CLI_INPUTS = {
    "driven, but no pulses": (
        ["compare", "rig", "--model", "pulses.yaml"],
        "run_0.csv: driven at 7000 A, but it holds no drive pulses and the model has drive: pulses",
    ),
    "blocks of other nodes": (
        ["compare", "rig", "--model", "others.yaml"],
        "nothing in it is for /inductrack/sim; its blocks are for /a, /b",
    ),
    "a device": (["compare", "rig", "--model", "/dev/zero"], "/dev/zero: cannot be read: not a regular file"),
    "broken YAML": (["simulate", "--model", "broken.yaml"], "broken.yaml, line 2: not valid YAML"),
}


@pytest.mark.parametrize("mistake", CLI_INPUTS)
def test_a_command_says_in_one_line_what_is_wrong(folder, monkeypatch, capsys, mistake):
    monkeypatch.chdir(folder)
    given, says = CLI_INPUTS[mistake]
    assert cli.main([*given, "--output", "out.csv"]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and says in said[0]
    assert not (folder / "out.csv").exists()


def test_coasting_needs_no_pulses_and_the_parameter_file_of_all_nodes_is_a_model(folder):
    from inductrack_ros.estimation.problem import lay_out

    campaign = load_campaign(folder / "rig")
    coasting = next(run for run in campaign.runs if not run.drive_current)
    assert not lay_out(coasting, Model.create(drive="pulses"), coasting.channels, 4).averaged
    assert campaign.load_model(Path(__file__).parent.parent / "config" / "default.yaml") == Model.default()


@pytest.mark.parametrize("written", ["9:30", "010", "9_300.0", "'9.3'", "9,3", "yes", "9.3 kg", "2026-01-01"])
def test_what_only_old_yaml_takes_for_a_number_is_none(tmp_path, written):
    """YAML 1.1 reads 570 kg out of 9:30, 8 kg out of 010."""
    (tmp_path / "model.yaml").write_text(f"/**:\n  ros__parameters: {{mass: {written}}}\n".replace("9,3", '"9,3"'))
    with pytest.raises(InputError, match="model.yaml: mass = .* is not a number; give one in"):
        Model.load(tmp_path / "model.yaml")


@pytest.mark.parametrize(
    ("written", "mass"),
    [("9", 9.0), ("9.", 9.0), ("+9.5", 9.5), ("9e0", 9.0), ("0.95e+1", 9.5), ("95.0e-1", 9.5), ("0x9", 9.0)],
)
def test_numbers_as_ros_2_reads_them(tmp_path, written, mass):
    (tmp_path / "model.yaml").write_text(f"/**:\n  ros__parameters: {{mass: {written}}}\n")
    assert Model.load(tmp_path / "model.yaml").parameters["mass"] == mass


def test_where_the_sim_node_starts_is_not_where_a_simulated_run_does(tmp_path, capsys):
    """What stands in a parameter file and is not used is said."""
    file, output = str(tmp_path / "model.yaml"), str(tmp_path / "run.csv")
    (tmp_path / "model.yaml").write_text("/**:\n  ros__parameters: {initial_state: surge_rate=20.0}\n")
    arguments = ["simulate", "--model", file, "--duration", "0.01", "--output", output]
    assert cli.main(arguments) == 0
    assert f"initial_state of {file} is for the sim node; --initial says where" in capsys.readouterr().out
    assert cli.main([*arguments, "--initial", "surge_rate=20.0"]) == 0
    assert "initial_state" not in capsys.readouterr().out


def test_a_campaign_runs_no_code(folder):
    """What its own model names is run once the user names it too, by whatever path; what --model names is named."""
    rig = folder / "rig"
    with (rig / "campaign.yaml").open("a") as file:
        file.write("model: evil.yaml\n")
    campaign = load_campaign(rig)
    with pytest.raises(
        InputError, match=r"evil.yaml: names the effect file .*evil.py, which is Python code.*--effects"
    ):
        campaign.load_model()
    with pytest.raises(InputError, match="evil.py"):
        campaign.load_model(effect_files=[folder / "other.py"])
    assert not (folder / "was_run").exists()
    with pytest.raises(InputError, match="evil.py"):  # it is run, and holds no effect
        campaign.load_model(effect_files=[rig / ".." / "rig" / "evil.py"])
    assert (folder / "was_run").exists()


class Elements(HTMLParser):
    """Counts the elements of a page, and the attributes that run something."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.counts: dict[str, int] = {}
        self.handlers: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.counts[tag] = self.counts.get(tag, 0) + 1
        self.handlers += [name for name, _ in attrs if name.startswith("on")]


def test_a_report_shows_hostile_names_as_they_are(folder):
    """Campaign and run named in HTML, with a quote: the page has the elements of one with honest names."""
    pages = []
    for campaign_name, run_name in (("rig", "run"), (NASTY, f'"{NASTY}')):
        rig = make_campaign(folder / campaign_name.replace("/", "") / "c", Model.default(), duration=0.1)
        (rig / "run_0.csv").rename(rig / f"{run_name}.csv")
        text = (rig / "campaign.yaml").read_text().replace("run_0.csv", f"'{run_name}.csv'")
        (rig / "campaign.yaml").write_text(text.replace("made <here>", f"'{campaign_name}'"))
        assert cli.main(["compare", str(rig), "--output", str(rig / "out")]) == 0
        pages.append(Elements((rig / "out" / "report.html").read_text()))
        assert campaign_name in (rig / "out" / "comparison.json").read_text()
    assert pages[0].counts == pages[1].counts and not pages[1].handlers


def test_nodes_stay_on_the_machine_unless_asked(ros, monkeypatch):
    """By default; and one that does is heard by another that did not ask for anything."""
    for name in domain.ASKED:
        monkeypatch.delenv(name, raising=False)
    domain.stay_local()
    assert "ROS stays on this machine" in domain.reach()
    for name, value in (
        (domain.RANGE, "SUBNET"),
        ("ROS_STATIC_PEERS", "10.0.0.2"),
        ("CYCLONEDDS_URI", "file:///x.xml"),
    ):
        with monkeypatch.context() as asked:
            asked.delenv(domain.RANGE, raising=False)
            asked.setenv(name, value)
            domain.stay_local()
            assert (name == domain.RANGE) == (domain.RANGE in domain.os.environ) and f"{name}={value}" in domain.reach()
    monkeypatch.delenv(domain.RANGE)
    sim = ros.start("sim")
    sim.wait_for("ROS stays on this machine")
    listener = ros.folder / "listener.py"
    listener.write_text(
        "import rclpy\n"
        "rclpy.init()\n"
        "node = rclpy.create_node('listener')\n"
        "while not node.count_publishers('/inductrack/pose'):\n"
        "    rclpy.spin_once(node, timeout_sec=0.05)\n"
        "print('heard')\n"
    )
    ros.start(str(listener)).wait_for("heard")
    assert sim.stop() == 0
