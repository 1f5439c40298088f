# SPDX-License-Identifier: Apache-2.0
"""How a node's process ends: within seconds of a signal, whatever the middleware does, with the status it earned.

Two things stand against that. Fast DDS has been seen to spin for ever in ``destroy_participant``. It does so inside C++
and holds the interpreter's lock, so that neither a Python thread nor a signal handler runs any more: `Deadline` is a
timer of the operating system. And the interpreter gives SIGINT its default back while it exits, so that a second Ctrl-C
kills a node that was about to end with 0: `leave` passes over the interpreter's exit."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import threading
from types import TracebackType
from typing import NoReturn

SIGNALS = signal.SIGINT, signal.SIGTERM
#: A command that starts the command after it with Ctrl-C held back until `Stop.listen`. Else a Ctrl-C in the first half
#: second kills the interpreter, with a traceback or with −2.
HELD_BACK = "env --block-signal=INT"
#: A command that starts the command after it and ends it, with SIGTERM, once the process that started it is gone.
#: Else a node lives on after a launch or a script that was killed.
NO_ORPHAN = "setpriv --pdeathsig TERM"
GRACE = 2.0  # s that the middleware gets to say good-bye to others, who else believe for 20 s that the node is there
PATIENCE = 10.0  # s that a node gets after a signal to come back from a call of the middleware

_CLOCK_MONOTONIC, _SIGEV_THREAD = 1, 2


class Stop:
    """What SIGINT and SIGTERM do: end at once while a node starts, ask it to stop once it runs or holds a file open.

    Later ones change nothing: a launched node gets Ctrl-C twice. A thread sees to it that a node ends too whose main
    thread does not come back from a call of the middleware, where Python's signal handlers do not run.
    """

    def __init__(self) -> None:
        self.running = False
        self.asked = False
        self._listening = False
        self._left = threading.Event()

    def listen(self) -> None:
        """From here on signals come to this object, also those that were held back while Python started (`HELD_BACK`).

        To be called in the main thread; a second call changes nothing."""
        if self._listening:
            return
        self._listening = True
        for number in SIGNALS:
            signal.signal(number, self._ask)
        read, write = os.pipe()
        os.set_blocking(write, False)
        signal.set_wakeup_fd(write, warn_on_full_buffer=False)
        threading.Thread(target=self._watch, args=[read], daemon=True).start()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)

    def left(self) -> None:
        """The node has left its loop; from here on signals change nothing."""
        self._left.set()

    def _ask(self, *_: object) -> None:
        if not (self.running or self._left.is_set()):
            os._exit(0)  # nothing is open yet; an exception would have to find its way out of imports and compilers
        self.asked = True

    def _watch(self, read: int) -> None:
        while os.read(read, 1)[0] not in SIGNALS:
            pass
        self._ask()
        if not self._left.wait(PATIENCE):
            print(
                f"error: the middleware has not answered for {PATIENCE:g} s after the signal; the node ends without it",
                file=sys.stderr,
            )
            os._exit(1)


STOP = Stop()


class _Event(ctypes.Structure):
    """`struct sigevent` of Linux, which is 64 bytes long: at its time ``function(value)`` is called in a thread of its
    own."""

    _fields_ = [
        ("value", ctypes.c_size_t), ("signal", ctypes.c_int), ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p), ("attributes", ctypes.c_void_p), ("rest", ctypes.c_byte * 32),
    ]  # fmt: skip


class Deadline:
    """``with Deadline(seconds, status):`` the process ends with the status where the block takes longer than that."""

    def __init__(self, seconds: float, status: int) -> None:
        self._seconds, self._status = seconds, status

    def __enter__(self) -> None:
        flush()  # nothing is written any more once the time is up
        self._timer = _timer(self._seconds, self._status)

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._timer()


def _timer(seconds: float, status: int):
    """Start it; returns what stops it."""
    try:
        libc = ctypes.CDLL(None)
        event = _Event(value=status, notify=_SIGEV_THREAD, function=ctypes.cast(libc._exit, ctypes.c_void_p).value)
        timer = ctypes.c_void_p()
        if libc.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
            raise OSError
        whole = int(seconds)
        times = (ctypes.c_long * 4)(0, 0, whole, int((seconds - whole) * 1e9))  # once
        libc.timer_settime(timer, 0, ctypes.byref(times), None)
        return lambda: libc.timer_delete(timer)
    except (OSError, AttributeError):  # no Linux: good enough while the interpreter's lock is free
        thread = threading.Timer(seconds, os._exit, [status])
        thread.daemon = True
        thread.start()
        return thread.cancel


def flush() -> None:
    """Write out what was printed, by Python and by C."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):  # a pipe whose reader has gone; a closed stream
            stream.flush()
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).fflush(None)


def leave(status: int) -> NoReturn:
    """End the process now, without the interpreter's own exit, in which C++ may hang and signals may kill."""
    flush()
    os._exit(status)
