# SPDX-License-Identifier: Apache-2.0
"""`sim`: the cradle in real time, in its own time, or in step with a controller. Equations live in the core."""

from __future__ import annotations

import math
import sys
import time

import numpy as np
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_msgs.msg import UInt64MultiArray
from std_srvs.srv import SetBool, Trigger

from ..core import rig
from ..core.errors import InputError
from ..core.model import Model
from ..core.options import COIL_PLACES, MODEL_OPTIONS, SIM
from ..core.parameters import PARAMETERS
from ..core.state import OUTPUTS
from .diagnostics import PERIOD, Diagnostics, strangers
from .domain import reach
from .drive import PulseQueue
from .listeners import Answerers
from .messages import waiting
from .overrides import Overrides
from .parameters import (
    declare,
    effect_parameters,
    given,
    in_words,
    model_options,
    when_set,
    with_values,
    without_unknown,
)
from .qos import profile, subscribe
from .rest import Rest
from .runtime import NAMESPACE, every, run
from .simulation import Simulation, parse_initial_state
from .topics import LOSSLESS, SimulatorTopics, channels, nanoseconds_of, stamp_of

OWN = {**SIM, **rig.declared()}
LIVE = {"speed_factor", "lockstep_timeout", "command_timeout", *PARAMETERS, *rig.declared()}
LONGEST_BATCH = 0.05  # s of real time spent on ticks before services and commands get their turn
LONGEST_DEBT = 0.1  # s of real time that the simulation may lag and still catch up
CATCH_UP = 2  # times the asked speed, at most, while it does: commands must get their turn between ticks
OUT_OF_BOUNDS, PAST_TRACK = "out of bounds", "past its track"  # why a run ends by itself
ASK_AGAIN = 1.0  # s without an answer after which a state in lockstep is published again for who may not have heard it


class SimNode(Node):
    """Message → pulse, advance, state → messages."""

    def __init__(self, overrides: Overrides = Overrides()) -> None:  # noqa: B008  it never changes
        super().__init__("sim", namespace=NAMESPACE, automatically_declare_parameters_from_overrides=True)
        start = given(self)
        shared = overrides.shared(self.get_fully_qualified_name())
        of_effects = {n: v for n, v in start.items() if "." in n and not n.startswith("measured.")}
        others = {n: v for n, v in start.items() if n not in of_effects}
        known = without_unknown(others, {**PARAMETERS, **MODEL_OPTIONS, **OWN}, self, shared)
        # The core checks what belongs to the model, effects' parameters included, in its own words.
        self.model = Model.from_mapping(known | of_effects, where="sim", shared=shared)
        of_effects = effect_parameters(self.model)
        in_model = {**PARAMETERS, **model_options(self.model), **of_effects}
        self._declared = {**in_model, **OWN}
        fixed = COIL_PLACES if self.model.track == "coils" else frozenset()
        self._options = declare(self, self._declared, live={*LIVE, *of_effects} - fixed)
        self._in_model = {*PARAMETERS, *of_effects}

        options = self._options
        coils = int(options["track_length"] / (0.5 * self.model.parameters["wavelength"]))
        self.queue = PulseQueue(coils, options["max_pulse_current"], self.model.parameters["pulse_length"])
        initial = parse_initial_state(options["initial_state"])
        self.simulation = Simulation(self.model, initial, options["rate"], self.queue)
        self.sensors = rig.Rig(options, self.model, options["seed"])
        own_time = options["publish_clock"] or options["lockstep"]
        self._epoch = 0 if own_time else None  # ns at simulated time 0; None: the time of the start or reset

        if options["lockstep"] and options["reliability"] == "best_effort":
            raise InputError(f"sim: reliability = 'best_effort': {LOSSLESS}")
        self._topics = SimulatorTopics(self, self._force_effects(), options)
        must = LOSSLESS if options["lockstep"] else ""
        self._commands = subscribe(self, PointStamped, "drive_pulses", self._take_pulse, profile(), must)
        self.create_service(SetBool, "~/pause", self._pause)
        self.create_service(Trigger, "~/step", self._step)
        self.create_service(Trigger, "~/reset", self._reset)
        when_set(self, self._changed, self._take_parameters)

        self.paused = options["paused"]
        self.deadline_misses = self.contacts = 0
        self._in_contact = False
        self._restart_time()
        self._clock_period = math.ceil(options["rate"] / options["clock_rate"] - 1e-9)
        self._noise = rig.noise(options)
        self._topics.places(stamp_of(self._stamp_ns()), self.model.parameters)
        self._details_period = max(1, round(options["rate"] / options["details_rate"]))
        if options["lockstep"]:
            self._questions = 0
            self._answerers = Answerers(self, "lockstep/done", "pose")
            self._expect_answer()
            subscribe(self, UInt64MultiArray, "lockstep/done", self._take_answer, profile(), must)
            every(self, 0.1, self._look_after_lockstep)
        else:
            every(self, 1.0 / options["rate"], self._wake)
        self._diagnostics = Diagnostics(self, "simulation")
        self._rest = Rest(self, options, controllers=int(self.model.drive == "pulses"))
        self._troubles: set[str] = set()  # that have been said
        every(self, PERIOD, self._diagnose)
        self._say_what_runs()
        self.finished = False

    # -- time -----------------------------------------------------------------------------------------------------

    def _restart_time(self) -> None:
        """Simulated time begins anew (start, reset)."""
        self._zero = time.time_ns() if self._epoch is None else self._epoch
        self._begin_run()

    def _begin_run(self) -> None:
        self._over = ""  # why the run has ended by itself and time stands still
        self._published = False  # the initial state, to begin with
        self._resume()

    def _begin_anew(self) -> None:
        """A new run, whose stamps follow those of the last one: clocks and bags know no way back."""
        follows = self._stamp_ns() + round(1e9 / self._options["rate"])
        try:
            self.simulation.reset()
        except InputError as error:  # parameters have changed since the start
            self.get_logger().error(f"no new run begins: {error}", once=True)
            return
        self._zero = follows
        self.sensors.restart()
        self._begin_run()

    def _resume(self) -> None:
        """From here on, so many ticks are due as real time passes (start, end of a pause, another speed factor)."""
        self._due_from = time.monotonic(), self.simulation.ticks
        self._last_wake = time.monotonic()

    def _stamp_ns(self) -> int:
        return self._zero + round(self.simulation.time * 1e9)

    def _wake(self) -> None:
        """Timer: advance as many ticks as real time asks for."""
        now = time.monotonic()
        rate, factor = self._options["rate"], self._options["speed_factor"]
        if not self._published:
            if not self._heard():
                self._resume()
                return
            self._publish()
            # The first state takes longer than others; time begins once it is out, or a rush would follow.
            self._resume()
        if self.paused or self._over:
            return
        if now - self._last_wake > 2.0 / rate:
            self.deadline_misses += 1
        self._last_wake = now
        since, ticks = self._due_from
        due = ticks + int((now - since) * factor * rate + 0.5) - self.simulation.ticks
        for _ in range(min(due, math.ceil(CATCH_UP * factor))):
            self._take_commands()
            if not self._tick() or time.monotonic() - now > LONGEST_BATCH:
                break
        behind = ticks + (now - since) * factor * rate - self.simulation.ticks
        if behind > LONGEST_DEBT * factor * rate:  # it will not catch up; time goes on from here
            self._due_from = time.monotonic(), self.simulation.ticks

    def _tick(self) -> bool:
        """One tick and what is published with it; False where it is the run's last."""
        try:
            begun = self.simulation.tick()
        except InputError as error:
            self.get_logger().error(str(error))
            self._over = OUT_OF_BOUNDS
            return False
        timeout = self._options["command_timeout"]
        if self.model.drive == "pulses" and self.queue.falls_silent(self.simulation.time, timeout):
            self.get_logger().warning(
                f"no drive pulse for {timeout:g} s (command_timeout): no thrust; is the controller running?"
            )
        for count, pulse in enumerate(begun, self.queue.fired - len(begun) + 1):
            self._topics.fired(stamp_of(self._zero + round(pulse.time * 1e9)), pulse, count)
        self._publish()
        if self._rest.is_past_track(self.simulation):
            self._over = PAST_TRACK
        return not self._over

    def _publish(self) -> None:
        simulation, x = self.simulation, self.simulation.x
        self._published = True
        stamp = stamp_of(self._stamp_ns())
        if self.paused or simulation.ticks % self._clock_period == 0:  # each step of a paused run is a time of its own
            self._topics.clock(stamp)
        self._topics.state(stamp, x)
        truth = channels(x, simulation.quantities())
        for s in self.sensors.step(simulation.time, np.array([truth[c] for c in OUTPUTS]), 1.0 / simulation.rate):
            measured_at = stamp_of(self._zero + round(s.time * 1e9))
            self._topics.measured(measured_at, s, self.model.parameters, self._noise)
        touching = min(truth["gap_top"], truth["gap_right"], truth["gap_left"]) < 0.0
        self.contacts += touching and not self._in_contact
        self._in_contact = touching
        if simulation.ticks % self._details_period == 0:
            self._topics.details(stamp, x, truth, simulation.wrenches(), self.model.parameters)

    # -- lockstep: simulated time waits for the controller -------------------------------------------------------

    def _look_after_lockstep(self) -> None:
        """Timer: publish the first state once somebody will answer; ask who came later, and say so when nobody does."""
        if self.paused or self._over:
            return
        silent = time.monotonic() - self._asked_at
        unheard = self._answerers.may_not_have_heard(self._questions)
        if not self._published and self._controller_listens():
            self._expect_answer()
            self._publish()
        elif self._published and silent > ASK_AGAIN and self._answer is None and unheard:
            self._asked_at = time.monotonic()
            self._topics.state(stamp_of(self._stamp_ns()), self.simulation.x)
        if time.monotonic() - self._answered_at > self._options["lockstep_timeout"]:
            self._answered_at = time.monotonic()
            missing = f"no answer on lockstep/done to the pose at {self.simulation.time:.3f} s"
            if self._published and not self._missed:
                self._missed = True
                self.queue.silences += (
                    1  # what it commanded before stays: simulated time stands still, so nothing fires
                )
            if self._answer is not None:
                missing = f"the answer speaks of {self._answer} pulses, {self._pulses_since_tick} came"
            self.get_logger().warning(
                f"lockstep: {missing} for {self._options['lockstep_timeout']:g} s; "
                "is the controller running, with lockstep: true?"
            )

    def _controller_listens(self) -> bool:
        """Whether somebody answers, and is heard."""
        return self.count_publishers("lockstep/done") > 0 and self._heard()

    def _heard(self) -> bool:
        """Whether all who listen are connected, and as many as are waited for: what is sent earlier would be lost. So
        would be the first pulses of a controller that is not heard yet."""
        if self.count_subscribers("pose") < self._options["listeners"]:
            return False
        if not self._options["lockstep"] and not self._options["listeners"]:
            return True
        controllers = self.count_publishers("drive_pulses")
        return controllers <= self._commands.get_publisher_count() and self._topics.listeners.all_hear()

    def _expect_answer(self) -> None:
        self._questions += 1
        self._pulses_since_tick = 0
        self._missed = False
        self._answer: int | None = None  # pulses the controller says it sent
        self._asked_at = self._answered_at = time.monotonic()

    def _take_answer(self, message: UInt64MultiArray) -> None:
        """`[stamp of the pose answered (ns), number of pulses sent in answer]`"""
        if len(message.data) != 2:
            self._refuse("lockstep/done must hold [stamp of the pose (ns), pulses sent in answer to it]")
        elif message.data[0] == self._stamp_ns():
            self._answer = int(message.data[1])
            self.queue.heard(self.simulation.time)
            self._go_on()

    def _go_on(self) -> None:
        """Next tick, once the answer and all the pulses it speaks of are here."""
        if self.paused or self._over or self._answer is None or self._pulses_since_tick < self._answer:
            return
        self._expect_answer()
        self._tick()

    # -- what comes in --------------------------------------------------------------------------------------------

    def _take_commands(self) -> None:
        """Take what has come before time goes on. The executor hands over one command in a turn, and a turn of a
        simulator that catches up is several ticks long.

        Time goes on under a flood too: after a command that is refused, and after as long as a tick lasts.
        """
        refused, until = self.queue.refused, time.monotonic() + 1.0 / self._options["rate"]
        for command, _ in waiting(self._commands):
            self._take_pulse(command)
            if self.queue.refused > refused or time.monotonic() > until:
                return

    def _take_pulse(self, message: PointStamped) -> None:
        at = (nanoseconds_of(message.header.stamp) - self._zero) / 1e9
        problem = self.queue.offer(self.simulation.time, at, message.point.x, message.point.y)
        if problem:
            self._refuse(f"drive pulse {problem}")
        elif self.model.drive != "pulses":
            self._refuse("drive pulses have no effect with drive: averaged; start sim with drive: pulses")
        if self._options["lockstep"]:
            self._pulses_since_tick += 1
            self._go_on()

    def _refuse(self, message: str) -> None:
        self.get_logger().warning(message, throttle_duration_sec=2.0)

    def _pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self.paused = request.data
        self._resume()
        if self._options["lockstep"] and not self.paused:
            self._go_on()
        going = f"{self._over}; reset begins anew" if self._over else "running"
        response.success, response.message = True, "paused" if self.paused else going
        return response

    def _step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self.paused:
            response.success, response.message = False, "not paused: call pause with data: true first"
            return response
        if self._over:
            response.success, response.message = False, f"{self._over}; reset begins anew"
            return response
        self._tick()
        response.success = self._over != OUT_OF_BOUNDS
        response.message = f"at {self._stamp_ns() / 1e9:.6f} s"  # as messages are stamped, also in a later run
        return response

    def _reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            self.simulation.reset()
        except InputError as error:
            response.success, response.message = False, str(error)
            return response
        self.sensors.restart()
        self._restart_time()
        response.success, response.message = True, "at the initial state, 0 s"
        return response

    def _changed(self, values: dict[str, object]) -> Model:
        """The model with these of its values; raises `InputError` for what cannot be, here and now."""
        for name in values.keys() & self._declared.keys():  # rclpy's own check of a range lets NaN pass
            self._declared[name].check(name, values[name])
        model = with_values(self.model, {n: v for n, v in values.items() if n in self._in_model})
        self.simulation.check(model)
        return model

    def _take_parameters(self, values: dict[str, object]) -> None:
        self.model = self._changed(values)
        self.simulation.change(self.model)
        self._options.update(values)
        self.sensors.change(self._options, self.model)
        self._noise = rig.noise(self._options)
        self._topics.places(stamp_of(self._stamp_ns()), self.model.parameters)
        if "speed_factor" in values:
            self._resume()

    # -- what it says ---------------------------------------------------------------------------------------------

    def _force_effects(self) -> list[str]:
        return [name for name in self.model.effects if not self.model.known_effects[name.partition(":")[0]].of_sensor]

    def _say_what_runs(self) -> None:
        factor = self._options["speed_factor"]
        real_time = "real time" if factor == 1.0 else f"{factor:g} × real time"
        mode = "lockstep" if self._options["lockstep"] else real_time
        self.get_logger().info(f"{in_words(self.model)}; {self._options['rate']:g} Hz, {mode}")
        self.get_logger().info(reach())

    def _diagnose(self) -> None:
        if not self.paused and self._rest.look(self.simulation):
            self._begin_anew()
        queue = self.queue
        troubles = {self._over: ""} if self._over else {}  # said when it happened
        troubles |= strangers(self, self.model.drive == "pulses")
        self._diagnostics.publish(
            {
                "deadline misses": self.deadline_misses,
                "late pulses": queue.late,
                "refused pulses": queue.refused,
                "lost controllers": queue.silences,
                "contacts": self.contacts,
            },
            {
                "simulated time (s)": f"{self.simulation.time:.3f}",
                "fired pulses": queue.fired,
                "in contact": self._in_contact,
                "paused": self.paused,
            },
            (not troubles, ", ".join(troubles)),
        )
        for name, sentence in troubles.items():
            if sentence and name not in self._troubles:
                self.get_logger().warning(sentence)
        self._troubles = set(troubles)


def main(args: list[str] | None = None) -> int:
    return run(SimNode, args)


if __name__ == "__main__":
    sys.exit(main())
