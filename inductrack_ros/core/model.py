# SPDX-License-Identifier: Apache-2.0
"""The cradle as users meet it: parameters, effects, simulation, forces; read from and written to ROS 2 parameter
files."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from . import kernel as kernels
from . import lane_kernel
from .coils.seam import SEAM, averaged_change
from .coils.settings import coil_track
from .coils.track import Coils
from .effects import Effect, load_effects, split_name
from .errors import InputError, announce, did_you_mean
from .model_names import arguments_of, beside, check_conditions, check_has, flat_names, text_list, write_model
from .options import DRIVES, TRACKS
from .parameter_files import blocks_for, merged, overridden, shared_names
from .parameters import PARAMETERS, Values, check_parameters
from .runs import Pulses, Trajectory
from .state import CHANNELS, COORDINATES, INDEX, MOTION, MOVING, OUTPUTS, STATES, Dof, as_dof
from .uncertainty import Uncertainty

_NONE = np.empty(0)


@dataclass(frozen=True)
class Model:
    """One parametrised model of the cradle, which never changes once made (see `with_changes`).

    ``parameters`` holds every entry of `parameters.PARAMETERS`; ``effects`` maps each active effect's full name
    (``sensor_bias:sway`` for a sensor's) to its parameters; ``dof`` is 1, 2, 4 or names of the coordinates that move;
    ``drive`` is ``averaged`` or ``pulses``; ``conditions`` are numbers of a run that effects ask for
    (``track_temperature``), which hold where a run has none of its own. ``track`` is ``averaged`` or ``coils``, single
    coils by ``coil_options`` (names of `options.COIL_OPTIONS` and ``track_length``): these can be simulated, and
    nothing else; a state then goes on with the coils' currents behind those of effects."""

    parameters: Mapping[str, float]
    effects: Mapping[str, Values] = field(default_factory=dict)
    dof: Dof = 4
    drive: str = "averaged"
    effect_files: tuple[str, ...] = ()
    conditions: Mapping[str, float] = field(default_factory=dict)
    track: str = "averaged"
    coil_options: Mapping[str, object] = field(default_factory=dict)

    # -- making one ---------------------------------------------------------------------------------------------

    @classmethod
    def create(
        cls,
        parameters: Mapping[str, object] | None = None,
        effects: Mapping[str, Mapping[str, object]] | Iterable[str] = (),
        dof: int | Sequence[str] = 4,
        drive: str = "averaged",
        effect_files: Iterable[str | Path] = (),
        where: str = "",
        conditions: Mapping[str, object] | None = None,
        track: str = "averaged",
        coil_options: Mapping[str, object] | None = None,
    ) -> Model:
        """A checked model. ``effects`` are names, or a mapping from names to parameter values. Raises `InputError`."""
        place = f"{where}: " if where else ""
        moving = as_dof(dof)
        if moving is None:
            raise InputError(f"{place}dof = {dof!r:.60}; it must be 1, 2, 4 or a list of {', '.join(COORDINATES)}")
        if drive not in DRIVES:
            raise InputError(f"{place}drive = {drive!r:.60}; it must be 'averaged' or 'pulses'")
        if track not in TRACKS:
            raise InputError(f"{place}track = {track!r:.60}; it must be 'averaged' or 'coils'")
        files = tuple(os.path.abspath(os.path.expanduser(f)) for f in effect_files)  # a saved model may go elsewhere
        known = load_effects(files)
        given = effects if isinstance(effects, Mapping) else {name: {} for name in effects}
        checked: dict[str, Values] = {}
        for name, values in given.items():
            item, _ = split_name(name, known, CHANNELS, where)
            for parameter in values:
                check_has(item, name, parameter, place)
            if item.only and item.only != drive:
                raise InputError(
                    f"{place}effect '{name}' belongs to the {item.only} drive; with drive: {drive} the pulses"
                    " themselves show it"
                )
            if track == "coils" and (changed := averaged_change(item)):
                raise InputError(
                    f"{place}effect '{name}' changes {changed}, which only the averaged track has; leave it out with"
                    " track: coils"
                )
            checked[name] = {
                p: declared.check(f"{name}.{p}", values.get(p, declared.default), where)
                for p, declared in item.parameters.items()
            }
        numbers = check_parameters(parameters or {}, where)
        options = dict(coil_options or {}) if track == "coils" else {}
        if track == "coils":
            coil_track(options, numbers, where)
        asked = check_conditions(conditions or {}, known, place)
        return cls(numbers, checked, moving, drive, files, asked, track, options)

    @classmethod
    def default(cls) -> Model:
        """The paper's model with the published η and γ and no effect."""
        return cls.create()

    @classmethod
    def load(cls, path: str | Path, extra_files: Iterable[str | Path] = (), trusted: bool = True) -> Model:
        """Read a ROS 2 parameter file, or a plain mapping of the same names.

        ``extra_files`` are effect files besides those the file names, which are Python code: one that is not
        ``trusted`` may name no others. What counts is what the node `/inductrack/sim` would take from it; its own
        parameters are passed over. Raises `InputError` naming the file and the parameter."""
        blocks, folder = blocks_for(path), Path(path).parent
        values = merged(blocks)
        if said := overridden(blocks):
            announce(f"warning: {path}: {said}")
        if not trusted:
            named = [beside(folder, f) for f in text_list(values.pop("effect_files", []), "effect_files", f"{path}: ")]
            given = {os.path.realpath(f) for f in extra_files}
            if others := [f for f in named if os.path.realpath(f) not in given]:
                raise InputError(
                    f"{path}: names the effect file {others[0]}, which is Python code and is run only when you name it:"
                    f" --effects {others[0]}"
                )
        return cls.from_mapping(values, str(path), extra_files, folder, shared_names(blocks))

    @classmethod
    def from_mapping(
        cls,
        values: Mapping[str, Any],
        where: str = "",
        extra_files: Iterable[str | Path] = (),
        folder: Path | None = None,
        shared: Collection[str] = (),
    ) -> Model:
        """A model from flat names: ``eta``, ``dof``, ``drive``, ``track`` and its options, ``effects``,
        ``effect_files``, ``<effect>.<parameter>``, ``conditions.<name>``.

        Names in ``shared`` were given to nodes of any name: one that no model has is passed over, and said.
        """
        return cls.create(**arguments_of(values, where, extra_files, folder, shared))

    def with_changes(
        self, parameters: Mapping[str, float] | None = None, effects: Mapping[str, Values] | None = None, **others: Any
    ) -> Model:
        """A copy with some ``parameters`` changed, and ``effects`` (all of them) replaced where given."""
        names = ("dof", "drive", "effect_files", "conditions", "track", "coil_options")
        kept: dict[str, Any] = {n: getattr(self, n) for n in names}
        return Model.create(
            {**self.parameters, **(parameters or {})},
            self.effects if effects is None else effects,
            **{**kept, **others},
        )

    def to_mapping(self) -> dict[str, object]:
        """Flat names and values, as `from_mapping` reads them."""
        return flat_names(self)

    def save(self, path: str | Path, comment: str = "", uncertainty: Uncertainty | None = None) -> None:
        """Write a ROS 2 parameter file, whole or not at all; with ``uncertainty`` it says how well its parameters are
        known."""
        write_model(path, self.to_mapping(), comment, uncertainty)

    # -- what it is made of -------------------------------------------------------------------------------------

    @cached_property
    def known_effects(self) -> dict[str, Effect]:
        """The catalogue and the user's own effects, by name."""
        return load_effects(self.effect_files)

    @property
    def kernel(self) -> kernels.Kernel:
        """The compiled kernel of everything known; effects are switched, not compiled in and out.

        Raises `InputError` for a track of single coils, of which the kernel is not the whole."""
        return self.averaged()._kernel

    def averaged(self, where: str = "") -> Model:
        """This model, whose track is averaged. Raises `InputError` for one of single coils."""
        if self.track != "averaged":
            raise InputError(
                f"{where}{': ' if where else ''}track: coils can be simulated (sim, simulate) and nothing else; set"
                " track: averaged in the model here"
            )
        return self

    @cached_property
    def _kernel(self) -> kernels.Kernel:
        return kernels.build(self.known_effects, announce, self.track == "coils")

    @property
    def lanes(self) -> lane_kernel.LaneKernel:
        """Machine code that carries many runs side by side, with the effects that are on."""
        return lane_kernel.build([self.known_effects[n] for n in self.kernel.effects if n in self.effects])

    @cached_property
    def coils(self) -> Coils | None:
        """The track's single coils; None for the averaged track."""
        if self.track == "averaged":
            return None
        settings = coil_track(self.coil_options, self.parameters)
        return Coils(settings, self.parameters["wavelength"], self._kernel)

    @cached_property
    def vector(self) -> np.ndarray:
        """The kernel's parameter vector P."""
        flat = dict(self.parameters)
        flat |= {f"{SEAM.name}.{p}": declared.default for p, declared in SEAM.parameters.items()}
        for name, item in self.known_effects.items():
            flat |= {c: self.condition(c, default) for c, default in item.conditions.items() if c not in PARAMETERS}
            for parameter, declared in item.parameters.items():
                value = self.effects.get(name, {}).get(parameter, declared.default)
                entries = declared.entries(f"{name}.{parameter}")
                values = value if isinstance(value, tuple) else (value,)
                flat |= dict(zip(entries, [*values, *[0.0] * (len(entries) - len(values))], strict=True))
        return np.array([flat[name] for name in self._kernel.parameters])

    def condition(self, name: str, default: float) -> float:
        """The value of a condition where a run has none of its own; ``default`` is the effect's."""
        return self.conditions.get(name, default)

    @cached_property
    def switches(self) -> np.ndarray:
        """Which of the kernel's effects are on."""
        return np.array([name in self.effects or name == SEAM.name for name in self._kernel.effects])

    def _those_on(self, which: Callable[[Effect], bool]) -> np.ndarray:
        """For each of the kernel's effects whether it is on and ``which`` is true of it."""
        return np.array([n in self.effects and which(self.known_effects[n]) for n in self._kernel.effects])

    @cached_property
    def moving(self) -> np.ndarray:
        """1 for each coordinate that moves, 0 for one that is held."""
        return np.array([float(c in MOVING[self.dof]) for c in COORDINATES])

    # -- running it ---------------------------------------------------------------------------------------------

    def initial_state(self, *, drive_current: float | None = None, **given: float) -> np.ndarray:
        """The eight states (8,) from named values; heave is the equilibrium heave unless given or held, the rest zero.

        The states of effects are no part of it: they settle on a run's own conditions, its ``drive_current`` (A) and
        its pulses, where the run begins. Raises `InputError` for an unknown name or a value that is not finite."""
        for name, value in given.items():
            if name not in STATES:
                raise InputError(f"initial state: unknown name '{name}'{did_you_mean(name, STATES)}")
            if isinstance(value, bool) or not isinstance(value, (int, float, np.number)) or not np.isfinite(value):
                raise InputError(f"initial state: {name} = {value!r} is not a finite number")
        x = np.zeros(len(STATES))
        for name, value in given.items():
            x[INDEX[name]] = value
        if "heave" not in given and self.moving[INDEX["heave"]]:
            x[INDEX["heave"]] = self.equilibrium_heave(x[INDEX["surge_rate"]], drive_current)
        return x

    @property
    def carries_states(self) -> bool:
        """Whether any effect that is on has states of its own."""
        return any(self.known_effects[e].states for e in self._kernel.effects if e in self.effects)

    @cached_property
    def active_states(self) -> np.ndarray:
        """Indices of the eight states and of those of the effects that are on: the others stay where they are."""
        carried = [k for k, name in enumerate(self._kernel.states) if name.partition(".")[0] in self.effects]
        return np.array([*range(8), *(k for k in carried if k >= 8)])

    def with_effect_states(
        self,
        x: np.ndarray,
        time: float = 0.0,
        P: np.ndarray | None = None,
        pulses: Pulses | Sequence[np.ndarray] | None = None,
        origin: float | None = None,
    ) -> np.ndarray:
        """``x`` with the effects' own states set to what they start on (steady values of quantities, or numbers), at
        parameters P or the model's.

        ``pulses`` (or what `Pulses.arrays` gives of them) drive the run; ``origin`` is the surge where it began, here
        unless given."""
        full = np.zeros(len(self._kernel.states))
        full[:8] = np.asarray(x, float)[:8]
        if len(full) > 8:
            without = self.switches & ~self._those_on(lambda item: bool(item.states))
            origin = float(full[0]) if origin is None else origin
            dx, _ = self._evaluate(time, full, self.vector if P is None else P, without, pulses, origin, starts=True)
            full[8:] = dx[len(full) :]
        return full

    def _whole_state(
        self,
        x: np.ndarray,
        time: float,
        drive_current: float | None,
        pulses: Pulses | None,
        origin: float | None = None,
    ) -> np.ndarray:
        """A copy of ``x`` of the kernel's length; the compiled code checks no bounds, so this does."""
        x = np.array(x, float)
        if x.shape == (8,):
            P = self._vector_at(drive_current)
            full = self.with_effect_states(x, time, P, pulses, origin)
            if self.coils is None:
                return full
            q = self._evaluate(time, full, P, self.switches, pulses, full[0] if origin is None else origin)[1]
            return np.concatenate([full, self.coils.steady(full[0], full[4], q).tail])
        whole = len(self._kernel.states) + (0 if self.coils is None else self.coils.rest.size)
        if x.shape != (whole,):
            raise InputError(f"a state has 8 entries, or {whole} with those of effects and coils; got shape {x.shape}")
        return x

    def equilibrium_heave(self, speed: float, drive_current: float | None = None) -> float:
        """Heave at which the vertical forces balance at ``speed`` (m/s), on the track where nothing carries. Newtons
        cancel to 1e-9; those of single coils are the mean of a pitch of whole coils."""
        from scipy.optimize import brentq  # slow to import; most nodes start without it

        x = np.zeros(len(self._kernel.states))
        x[INDEX["surge_rate"]] = speed
        P = self._vector_at(drive_current)

        on = self.switches & ~self._those_on(self.passes_on)

        def force(heave: float) -> float:
            x[INDEX["heave"]] = heave
            full = self.with_effect_states(x, P=P)
            q = self._evaluate(0.0, full, P, on)[1]
            if self.coils is None:
                return q[_FORCE_HEAVE]
            forces = self.coils.mean_forces(-2.0 * self.coils.reach, speed, q)
            return self._evaluate(0.0, full, self._with_coil_forces(P, forces), on)[1][_FORCE_HEAVE]

        low, high = -self.parameters["nominal_gap"] - 2e-3, max(self.parameters["nominal_gap"], 1e-3)
        if not force(low) > 0:
            raise InputError(
                f"nothing carries the cradle at {speed:g} m/s, not even the track; look at mass and contact_stiffness"
            )
        for _ in range(6):
            if force(high) < 0:
                finest = 1e-15 if self.coils is None else 1e-11
                found: Any = brentq(force, low, high, xtol=finest, rtol=np.float64(1e-14))
                return float(found)
            high *= 2
        raise InputError(f"the lift exceeds the weight at any gap at {speed:g} m/s; give heave in the initial state")

    @staticmethod
    def passes_on(item: Effect) -> bool:
        """Whether an effect takes the vertical force up and passes it on in time (an elastic frame): balance is where
        there is none."""
        return bool(item.states) and any("force_heave" in part.changes for part in item.parts)

    def simulate(
        self,
        times: np.ndarray,
        x: np.ndarray,
        drive_current: float | None = None,
        pulses: Pulses | None = None,
        start: float | None = None,
        longest_step: float = 1.0,
        further: bool = False,
    ) -> Trajectory:
        """Integrate from ``x``, true at ``start`` (s, the first of ``times`` unless given), through ``times`` (n,),
        rising.

        Thrust is the averaged law at ``drive_current`` (A), or with ``drive: pulses`` that of ``pulses``. The run's
        travel counts from x. Where x holds no states of effects, (8,), these start from the run's own conditions. A
        state that leaves all bounds ends in NaN rows. ``further`` asks for the channels beside the motion too, which
        takes longer."""
        times = np.ascontiguousarray(times, float)
        if times.ndim != 1 or times.size == 0 or not np.isfinite(times).all() or (np.diff(times) < 0).any():
            raise InputError("simulate: times must be a rising list of seconds")
        begin = times[0] if start is None else start
        x = self._whole_state(x, begin, drive_current, pulses)
        outputs = np.empty((1, times.size, len(OUTPUTS if further else MOTION)))
        state = x[None].copy()
        self._run(times, begin, state, x[0], drive_current, pulses, longest_step, outputs)
        return Trajectory(times, outputs[0], state[0])

    def advance(
        self,
        x: np.ndarray,
        time: float,
        until: float,
        drive_current: float | None = None,
        pulses: Pulses | None = None,
        origin: float = 0.0,
    ) -> np.ndarray:
        """The state at ``until`` from ``x`` at ``time``: one step of a real-time loop. ``origin`` is the surge where
        the run began."""
        state = self._whole_state(x, time, drive_current, pulses, origin)[None]
        self._run(
            np.array([until], dtype=float),
            time,
            state,
            origin,
            drive_current,
            pulses,
            1.0,
            np.empty((1, 1, len(MOTION))),
        )
        return state[0]

    def _run(self, times, start, state, origin, drive_current, pulses, longest, outputs) -> None:
        averaged = self.drive == "averaged"
        P = self._vector_at(drive_current)
        pt, pp, pc = _NONE, _NONE, _NONE
        if not averaged and pulses is not None:
            pt, pp, pc = pulses.arrays(self.parameters["wavelength"])
        if self.coils is not None:
            arguments = (self.switches, self.moving, float(origin), averaged, pt, pp, pc, float(longest))
            self.coils.simulate(times, float(start), state[0], P.copy(), arguments, outputs[0])
            return
        self._kernel.simulate_batch(  # float(): for a whole number it would be compiled anew
            times,
            float(start),
            state,
            P[None],
            self.switches[None],
            self.moving,
            np.array([float(origin)]),
            averaged,
            pt,
            pp,
            pc,
            float(longest),
            outputs,
        )

    def _evaluate(self, time, x, P, on, pulses=None, origin=0.0, starts=False):
        """Rates and quantities at one moment; with ``starts`` what the effects' states start on stands behind the
        rates."""
        dx, q = np.zeros(len(x) + (len(x) - 8 if starts else 0)), np.zeros(len(kernels.QUANTITIES))
        arrays = (
            pulses.arrays(self.parameters["wavelength"])
            if isinstance(pulses, Pulses)
            else pulses or (_NONE, _NONE, _NONE)
        )
        # A measured run's are its own.
        averaged = self.drive == "averaged" and (pulses is None or isinstance(pulses, Pulses))
        self._kernel.evaluate(
            float(time), np.ascontiguousarray(x), P, on, self.moving, float(origin), averaged, *arrays, dx, q
        )
        return dx, q

    def quantities(
        self,
        x: np.ndarray,
        time: float = 0.0,
        drive_current: float | None = None,
        pulses: Pulses | None = None,
        origin: float = 0.0,
    ) -> dict[str, float]:
        """The named quantities of `kernel.QUANTITIES` (gaps, forces per array, …) and the accelerations at one moment,
        SI."""
        P, x = self._at(x, time, drive_current, pulses, origin)
        dx, q = self._evaluate(time, x, P, self.switches, pulses, origin)
        return dict(zip(kernels.QUANTITIES, q.tolist(), strict=True)) | {
            f"{c}_acceleration": float(dx[4 + i]) for i, c in enumerate(COORDINATES)
        }

    def wrenches(
        self,
        x: np.ndarray,
        time: float = 0.0,
        drive_current: float | None = None,
        pulses: Pulses | None = None,
        origin: float = 0.0,
    ) -> dict[str, np.ndarray]:
        """Forces (N) and roll moment (N·m) apart, each (4,) in the order surge, sway, heave, roll.

        ``lift`` (with slip and its moment), ``drag``, ``thrust``, ``contact``, ``weight``, each effect by name, and
        ``total``. An effect's wrench is what would be missing without it; one that changes a quantity inside the model
        (say the resistance) shows there too, so the parts add up without those.
        """
        P, x = self._at(x, time, drive_current, pulses, origin)
        _, q = self._evaluate(time, x, P, self.switches, pulses, origin)
        g = dict(zip(kernels.QUANTITIES, q, strict=True))
        total = q[_TOTAL]
        parts = {
            "lift": _arrays_wrench(g, "repulsion"),
            "drag": np.array([-g["magnetic_drag"], 0.0, 0.0, 0.0]),
            "thrust": np.array([g["thrust"], 0.0, 0.0, 0.0]),
            "contact": _arrays_wrench(g, "normal"),
            "weight": np.array([0.0, 0.0, -self.parameters["mass"] * self.parameters["gravity"], 0.0]),
        }
        for i, name in enumerate(self._kernel.effects):
            if self.switches[i] and name in self.effects:
                without = self.switches.copy()
                without[i] = False
                parts[name] = total - self._evaluate(time, x, P, without, pulses, origin)[1][_TOTAL]
        return parts | {"total": total.copy()}

    def _at(self, x, time, drive_current, pulses, origin) -> tuple[np.ndarray, np.ndarray]:
        """The parameter vector, with the forces of the coils in it, and the kernel's states at ``x``."""
        P, x = self._vector_at(drive_current), self._whole_state(x, time, drive_current, pulses, origin)
        if self.coils is None:
            return P, x
        tail, x = x[len(self._kernel.states) :], x[: len(self._kernel.states)]
        q = self._evaluate(time, x, P, self.switches, pulses, origin)[1]
        return self._with_coil_forces(P, self.coils.forces(x[0], tail, q)), x

    def _with_coil_forces(self, P: np.ndarray, forces: np.ndarray) -> np.ndarray:
        P = P.copy()
        first = self._kernel.parameters.index(f"{SEAM.name}.{next(iter(SEAM.parameters))}")
        P[first : first + len(forces)] = forces
        return P

    def _vector_at(self, drive_current: float | None) -> np.ndarray:
        if drive_current is None:
            return self.vector
        P = self.vector.copy()
        P[_DRIVE_CURRENT] = drive_current
        return P


_FORCE_HEAVE = kernels.QUANTITIES.index("force_heave")
_TOTAL = [kernels.QUANTITIES.index(n) for n in ("force_surge", "force_sway", "force_heave", "moment_roll")]
_DRIVE_CURRENT = list(PARAMETERS).index("drive_current")


def _arrays_wrench(g: Mapping[Any, float], kind: str) -> np.ndarray:
    """Sum of one kind of force over the three arrays, (37) and the moment of (40)."""
    c = np.sqrt(0.5)
    top, right, left = (g[f"{kind}_{side}"] for side in ("top", "right", "left"))
    moment = (
        g["arm_top_x"] * top
        + c * right * (g["arm_right_y"] - g["arm_right_x"])
        - c * left * (g["arm_left_x"] + g["arm_left_y"])
    )
    return np.array([0.0, c * (left - right), top - c * (right + left), moment])
