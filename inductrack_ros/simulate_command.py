# SPDX-License-Identifier: Apache-2.0
"""``inductrack simulate``: a run, or a campaign of runs, as it is or as the rig's sensors would measure it."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from .core.errors import InputError, did_you_mean
from .core.named_values import named_values
from .core.output_folder import check_place, output_folder

if TYPE_CHECKING:
    from .core.model import Model, Trajectory
    from .core.rig import Record, Rig

#: Where a run starts unless told otherwise, as the node's does: the paper's launch.
LAUNCH = "surge_rate=15.5"
MOST_SAMPLES = 10_000_000
EPILOG = """examples:
  inductrack simulate --initial surge_rate=16.1,sway=0.004 --duration 2 --output run.csv
  inductrack simulate --measured --model secret.yaml --seed 1 --output run.csv
  inductrack simulate --model secret.yaml --seed 1 --run surge_rate=16.1,sway=0.002 --run surge_rate=22,drive_current=0 --output my_rig

Writes time, surge, sway, heave, roll and their rates; a bag has the topics that the sim node publishes.
With --measured a CSV has what the sensors deliver and nothing else, a bag has it under measured/ beside the truth. How they
measure stands in MODEL.yaml, by the sim node's own names: measured.heave.noise, measured.pose.rate, measured.gap_top.dropout, …,
seed, and sensor effects such as sensor_delay:heave.
With --run the folder has one CSV a run (--bags: one bag), campaign.yaml, and truth.yaml, the model that flew.
An existing CSV is replaced; an existing bag or campaign is not."""  # noqa: E501


@dataclass(frozen=True)
class Flight:
    """One run as it is to be flown: its initial state by name, its current (A), None for the model's, and its
    conditions."""

    initial: Mapping[str, float]
    drive_current: float | None
    conditions: Mapping[str, float] = field(default_factory=dict)

    def for_effects_of(self, model: Model) -> Flight:
        """The same with what this model's effects call conditions taken out of the initial state."""
        asked = {c for item in model.known_effects.values() for c in item.conditions}
        conditions = {n: v for n, v in self.initial.items() if n in asked}
        return replace(self, initial={n: v for n, v in self.initial.items() if n not in asked}, conditions=conditions)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's options."""
    parser.add_argument(
        "--model", metavar="MODEL.yaml", help="the model, a ROS 2 parameter file (default: the paper's)"
    )
    parser.add_argument(
        "--initial",
        metavar="NAME=VALUE,…",
        help=f"initial state, SI; heave: the equilibrium at that speed unless given, the rest 0 (default: {LAUNCH})",
    )
    parser.add_argument("--duration", metavar="S", type=float, default=3.0, help="seconds to simulate (default: 3)")
    parser.add_argument("--rate", metavar="HZ", type=float, default=500.0, help="samples a second (default: 500)")
    parser.add_argument(
        "--drive-current", metavar="A", type=float, help="drive current, 0 to coast (default: the model's, 7000)"
    )
    parser.add_argument("--measured", action="store_true", help="write what the rig's sensors would deliver")
    parser.add_argument(
        "--seed", type=int, help="seed of the sensors' noise (default: that of MODEL.yaml, else another each time)"
    )
    parser.add_argument(
        "--run",
        metavar="NAME=VALUE,…",
        action="append",
        dest="runs",
        help=(
            "a run of a campaign as measured: its initial state and, if wanted, drive_current and conditions"
            " (track_temperature=35); repeat it for more runs"
        ),
    )
    parser.add_argument("--bags", action="store_true", help="with --run: bags instead of CSV files")
    parser.add_argument(
        "--output",
        metavar="RUN.csv|BAG|DIR",
        required=True,
        help="a .csv file, or else a rosbag2 folder to be made; with --run the campaign's folder",
    )
    parser.epilog = EPILOG


def run(arguments: argparse.Namespace) -> None:
    """Simulate and write."""
    _check(arguments)
    flights = _flights(arguments)
    output = Path(arguments.output)
    _check_output(output, bool(arguments.runs))

    from .core.model import Model

    model = Model.load(arguments.model) if arguments.model else Model.default()
    if model.drive == "pulses":
        raise InputError(
            f"{arguments.model}: drive: pulses needs the controller node, which fires them; set drive: averaged here"
        )
    flights = [flight.for_effects_of(model) for flight in flights]
    measured = arguments.measured or bool(arguments.runs)
    values = _sensor_values(arguments.model)
    if arguments.runs:
        _campaign(output, arguments, model, values, flights)
        return
    flown = _flown(model, flights[0], arguments)
    seed = _seed(arguments.seed, values)
    records = _record(model, values, seed, flown, arguments.rate) if measured else None
    _write(output, flown, records, model)
    _say(output, model, flights[0], flown)
    if records is not None:
        print(_delivered(records, seed))
    elif arguments.model and arguments.initial is None and _starts_otherwise(arguments.model):
        print(f"initial_state of {arguments.model} is for the sim node; --initial says where this run starts")
    elif passed_over := [n for n in (*values, *_sensor_effects(model)) if n != "seed"]:
        print(
            f"{passed_over[0]}{' and others' if passed_over[1:] else ''} of {arguments.model}: of sensors, which show"
            " with --measured only"
        )


def _check(arguments: argparse.Namespace) -> None:
    for name, unit in (("duration", "s"), ("rate", "Hz")):
        value = getattr(arguments, name)
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"--{name} {value:g}: must be above 0 {unit}")
    samples = arguments.duration * arguments.rate * len(arguments.runs or [1])
    if samples > MOST_SAMPLES:
        raise InputError(f"--duration × --rate is {samples:g} samples; at most {MOST_SAMPLES} are written")
    if arguments.runs and arguments.initial is not None:
        raise InputError("--initial and --run: each --run has its own initial state; leave --initial out")
    if arguments.bags and not arguments.runs:
        raise InputError("--bags: is for a campaign, with --run; for one bag give --output a name without .csv")
    if arguments.seed is not None and not 0 <= arguments.seed < 2**31:
        raise InputError(f"--seed {arguments.seed}: must lie in [0, {2**31 - 1}]")


def _flights(arguments: argparse.Namespace) -> list[Flight]:
    from .core.parameters import PARAMETERS

    current = arguments.drive_current
    if current is not None:
        PARAMETERS["drive_current"].check("--drive-current", current)
    if not arguments.runs:
        return [
            Flight(
                named_values(LAUNCH if arguments.initial is None else arguments.initial, "--initial", LAUNCH), current
            )
        ]
    flights = []
    for given in arguments.runs:
        initial = named_values(given, "--run", "surge_rate=16.1,drive_current=0")
        own = initial.pop("drive_current", current)
        if own is not None:
            PARAMETERS["drive_current"].check("--run: drive_current", own)
        flights.append(Flight(initial, own))
    return flights


def _check_output(output: Path, campaign: bool) -> None:
    is_csv = output.suffix.lower() == ".csv"
    if campaign and is_csv:
        raise InputError(f"--output {output}: with --run a folder is written; give one")
    if os.path.lexists(output) and (
        output.is_dir() if is_csv else not campaign or not output.is_dir() or any(output.iterdir())
    ):
        raise InputError(f"--output {output}: exists already; choose another name or delete it first")
    if str(output) == "-":
        raise InputError("--output -: a run is written into a file, not a stream; give it a name, e.g. run.csv")
    check_place(output.parent)
    if not output.absolute().parent.is_dir():
        raise InputError(f"--output {output}: there is no folder {output.parent}; create it first")


def _starts_otherwise(path: str) -> bool:
    """Whether a parameter file says where the sim node starts."""
    from .core.parameter_files import blocks_for, merged

    return "initial_state" in merged(blocks_for(path))


def _sensor_values(path: str | None) -> dict[str, float]:
    """How the sensors measure, as far as the parameter file says so: ``measured.…`` and ``seed``."""
    from .core.options import SENSORS, SIM
    from .core.parameter_files import blocks_for, merged
    from .core.rig import declared

    if path is None:
        return {}
    known, found = declared(), {}
    for name, value in merged(blocks_for(path)).items():
        if name == "seed":
            found[name] = SIM["seed"].check(name, value, path)
        elif name.startswith(SENSORS):
            if name not in known:
                raise InputError(f"{path}: unknown parameter '{name}'{did_you_mean(name, known)}")
            found[name] = known[name].check(name, value, path)
    return found


def _seed(given: int | None, values: Mapping[str, float]) -> int:
    """The seed asked for, else one that is drawn, so that it can be told."""
    import secrets

    wanted = values.get("seed", -1) if given is None else given
    return int(wanted) if wanted >= 0 else secrets.randbelow(2**31)


def _sensor_effects(model: Model) -> list[str]:
    return [name for name in model.effects if model.known_effects[name.partition(":")[0]].of_sensor]


def _flown(model: Model, flight: Flight, arguments: argparse.Namespace) -> Trajectory:
    import numpy as np

    times = np.arange(round(arguments.duration * arguments.rate) + 1) / arguments.rate
    model = model.with_changes(conditions={**model.conditions, **flight.conditions})
    start = model.initial_state(drive_current=flight.drive_current, **flight.initial)
    flown = model.simulate(times, start, flight.drive_current, further=arguments.measured or bool(arguments.runs))
    lost = np.flatnonzero(~np.isfinite(flown.states).all(axis=1))
    if lost.size:
        raise InputError(
            f"the simulation leaves all bounds at {times[lost[0]]:g} s; look at the initial state and the model's"
            " parameters"
        )
    return flown


def _rig(model: Model, values: Mapping[str, float], seed: int) -> Rig:
    from .core.rig import Rig

    return Rig(values, model, seed)


def _record(model: Model, values: Mapping[str, float], seed: int, flown: Trajectory, rate: float) -> dict[str, Record]:
    found = _rig(model, values, seed).record(flown.times, flown.outputs, 1.0 / rate)
    if not any(record.times.size for record in found.values()):
        raise InputError(
            "the sensors deliver nothing: all are off, or every sample is lost; look at measured.<sensor>.rate and"
            " dropout"
        )
    return found


def _write(output: Path, flown: Trajectory, records: Mapping[str, Record] | None, model: Model) -> None:
    from .core.state import GAPS, STATES
    from .data import write_bag, write_csv
    from .data.measured import table

    if output.suffix.lower() != ".csv":
        columns = {name: flown[name] for name in (*STATES, *(GAPS if records is not None else ()))}
        write_bag(output, flown.times, columns, measured=records, gravity=model.parameters["gravity"])
    elif records is None:
        write_csv(output, flown.times, {name: flown[name] for name in STATES}, overwrite=True)
    else:
        write_csv(output, *table(records), overwrite=True)


def _say(output: Path, model: Model, flight: Flight, flown: Trajectory) -> None:
    from .core.flight import story, why

    print(f"{output}: {flown.times[-1]:g} s, {len(flown.times)} samples; {story(flown)}")
    start = model.initial_state(drive_current=flight.drive_current, **flight.initial)
    if reason := why(model, flown, start, flight.drive_current):
        print(reason)


def _delivered(records: Mapping[str, Record], seed: int) -> str:
    counts = ", ".join(f"{name} {record.times.size}" for name, record in records.items())
    return f"measured: {counts} samples; seed {seed}"


# ---------------------------------------------------------------- a campaign


def _campaign(
    output: Path, arguments: argparse.Namespace, model: Model, values: Mapping[str, float], flights: Sequence[Flight]
) -> None:
    """A folder with a file for each flight as measured, ``campaign.yaml`` and ``truth.yaml``."""
    seed = _seed(arguments.seed, values)
    width = max(len(str(len(flights) - 1)), 2)
    names = [f"run_{i:0{width}d}{'' if arguments.bags else '.csv'}" for i in range(len(flights))]
    with output_folder(output) as folder:
        for i, (name, flight) in enumerate(zip(names, flights, strict=True)):
            flown = _flown(model, flight, arguments)
            records = _record(model, values, seed + i, flown, arguments.rate)
            _write(folder / name, flown, records, model)
            _say(output / name, model, flight, flown)
        text = _campaign_text(output.name, _rig(model, values, seed), names, flights, model)
        (folder / "campaign.yaml").write_text(text, encoding="utf-8")
        _truth(model, values).save(
            folder / "truth.yaml",
            "What flew, and how it was read. Nothing takes it unless it is named: --model truth.yaml",
        )
    print(
        f"{output}: {len(names)} runs as the sensors measured them, seeds {seed} to {seed + len(names) - 1}; truth.yaml"
        " says what flew"
    )


def _truth(model: Model, values: Mapping[str, float]) -> Model:
    """The model with the sensors' biases and delays (``measured.…``) as effects, so that it predicts what was
    measured."""
    effects = {name: dict(parameters) for name, parameters in model.effects.items()}
    for name, value in values.items():
        _, _, rest = name.partition(".")
        channel, _, what = rest.partition(".")
        if what in ("bias", "delay") and value:
            own = effects.setdefault(f"sensor_{what}:{channel}", {what: 0.0})
            own[what] += value
    return model.with_changes(effects=effects)


def _campaign_text(name: str, rig: Rig, files: Sequence[str], flights: Sequence[Flight], model: Model) -> str:
    import yaml

    from .core.rig import SENSORS

    noise = {
        c: rig.values[f"measured.{c}.noise"]
        for sensor, channels in SENSORS.items()
        for c in channels
        if rig.values[f"measured.{sensor}.rate"] > 0 and rig.values[f"measured.{c}.noise"] > 0
    }
    currents = [model.parameters["drive_current"] if f.drive_current is None else f.drive_current for f in flights]
    conditions = [{"conditions": dict(f.conditions)} if f.conditions else {} for f in flights]
    runs = [
        {"file": file, "drive_current": float(current), **more}
        for file, current, more in zip(files, currents, conditions, strict=True)
    ]
    content = {"name": name, "noise_std": noise, "dof": model.dof, "runs": runs}
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110)
