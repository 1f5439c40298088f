# SPDX-License-Identifier: Apache-2.0
"""Where independent work is done: threads of this machine, or workers of a dask cluster that the user already has.

Both are a `map` that returns results in order, the same to the last bit. For that, a task is a pure function of its
input, small matrices are never split over threads, and a worker of another version is refused. If a worker dies, dask
runs its tasks again on another.
"""

from __future__ import annotations

import copyreg
import functools
import hashlib
import os
import pickle
import platform
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path

from threadpoolctl import threadpool_limits

from .core import channels
from .core.errors import InputError
from .core.model import Model
from .core.user_files import run_file, use_shipped

#: How long (s) to look for a scheduler.
PATIENCE = 10.0
#: How often a task may meet a dying worker before it is taken for the cause.
DEATHS = 10
#: For how long (s) all workers may be gone before nobody is taken to bring them back: a start takes seconds, on a busy
#: machine a minute.
GONE = 180.0
#: How often (s) to look whether there are workers while a result is awaited.
LOOK = 1.0


class Threads:
    """The threads of this machine, all of them unless ``count`` says otherwise."""

    def __init__(self, count: int | None = None):
        self.count = count or os.cpu_count() or 1

    def map(self, task: Callable, items: Sequence) -> list:
        """``task`` of every item, in order. Compiled simulations release the interpreter, so threads do run at once."""
        if self.count == 1 or len(items) == 1:
            return [task(item) for item in items]
        with ThreadPoolExecutor(self.count) as pool:
            try:
                return list(pool.map(task, items))
            except KeyboardInterrupt:
                pool.shutdown(wait=False, cancel_futures=True)
                raise


class Cluster:
    """The workers of a dask scheduler; ``client`` is a `dask.distributed.Client`."""

    def __init__(self, client):
        self.client = client

    def map(self, task: Callable, items: Sequence) -> list:
        """``task`` of every item, in order. What the task refers to travels with it, users' effect files included."""
        return list(self.stream(task, items))

    def stream(self, task: Callable, items: Sequence) -> Iterator:
        """As `map`, each result as soon as it and those before it are there. Raises `InputError` where the workers are
        gone for good."""
        from dask.distributed import KilledWorker

        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Sending large graph")  # a campaign is ten megabytes
            # A result, not data: made again if its worker dies.
            sent = self.client.submit(_same, _pack(task), pure=False)
            futures = self.client.map(_work, [_pack(i) for i in items], task=sent, here=_versions(), pure=False)
        try:
            for future in futures:
                yield pickle.loads(self._result(future))
        except KilledWorker as error:
            raise InputError(
                f"the cluster: a task outlived {DEATHS} workers; is there enough memory on each? ({error})"
            ) from error
        finally:  # also after Ctrl-C: nothing goes on in the background
            self.client.cancel(futures)

    def _result(self, future) -> bytes:
        """A task's result, however long it takes while there are workers, or some may still come."""
        from dask.distributed import TimeoutError

        there, seen = False, time.monotonic()
        while True:
            try:
                return future.result(timeout=LOOK)
            except TimeoutError:
                if future.done():  # since; or that was the task's own error
                    return future.result()
                if self.client.nthreads():
                    there, seen = True, time.monotonic()
                elif there and time.monotonic() - seen > GONE:
                    raise InputError(
                        f"the cluster: all workers have been gone for {GONE:g} s; start them again with 'dask worker'"
                        " (a LocalCluster gives a worker up whose restart takes longer than distributed.deploy."
                        "lost-worker-timeout)"
                    ) from None


@contextmanager
def workers(scheduler: str | None = None) -> Iterator[Threads | Cluster]:
    """This machine's threads, or with a ``scheduler``'s address (``tcp://…``) its workers. Raises `InputError`."""
    if not scheduler:
        yield Threads()
        return
    try:
        import dask
        from dask.distributed import Client
    except ImportError as error:
        raise InputError("--scheduler needs dask: pip install 'inductrack_ros[cluster]'") from error
    with dask.config.set({"distributed.scheduler.allowed-failures": DEATHS}):
        try:
            client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(
                f"--scheduler {scheduler}: nothing answers there; start one with 'dask scheduler' and give the address"
                " it prints"
            ) from error
    with client:
        yield Cluster(client)


# -- on the workers ---------------------------------------------------------------------------------------------------


def _same(packed: bytes) -> bytes:
    return packed


def _work(packed: bytes, task: bytes, here: tuple) -> bytes:
    """Run one task on a worker. Everything is packed by us, so that dask's own serialisation has no say in the bits."""
    if _versions() != here:
        differing = [f"{b} here" for b in here if b not in _versions()]
        raise InputError(
            f"worker on {platform.node()}: {'; '.join(differing)}, not there; install the same on all machines"
        )
    _begin_work()
    return _pack(_unpacked(task)(pickle.loads(packed)))


_at_work: list[bool] = []  # not empty in a worker's process


@functools.cache
def _begin_work() -> None:
    _at_work.append(True)
    threadpool_limits(1, "blas")  # for good: taken back in one thread it would be gone in all


@functools.lru_cache(maxsize=1)
def _unpacked(task: bytes) -> Callable:
    return pickle.loads(task)


def _pack(value: object) -> bytes:
    import cloudpickle

    return cloudpickle.dumps(value)


@functools.cache
def _versions() -> tuple[str, ...]:
    """What has a say in the bits: the sources of this package and the versions of what computes."""
    sources = hashlib.sha256()
    for path in [*sorted(Path(__file__).parent.rglob("*.py")), *map(Path, channels.user_files())]:
        sources.update(path.expanduser().read_bytes())
    packages = [f"{name} {version(name)}" for name in ("numpy", "scipy", "numba")]
    return (
        f"inductrack_ros sources {sources.hexdigest()[:12]}",
        f"Python {platform.python_version()}",
        platform.machine(),
        *packages,
    )


def _restore(values: tuple, files: dict[str, bytes]) -> Model:
    if _at_work:  # at home the files themselves count, which may have been edited since
        use_shipped(files)
    return Model(*values)


def _reduce(model: Model) -> tuple:
    """A model as its fields and the text of its effect files; what is compiled is compiled again, or is in the
    cache."""
    files = {f: run_file(f).content for f in model.effect_files}
    return _restore, (tuple(getattr(model, f.name) for f in fields(model)), files)


copyreg.pickle(Model, _reduce)
