"""The workers: a cluster of processes on this machine, or one that is there already. Dask's warnings stay unsaid."""

from __future__ import annotations

import atexit
import logging
import math
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import Any

from pipeline.archive.jobs import Job, Outcome, State
from pipeline.archive.memory import GB, per_worker
from pipeline.archive.watch import NOBODY, Watch
from schemas.errors import DataError

PATIENCE_S = 10.0  # for a scheduler to answer, and for its first worker
CLOSING_S = 5.0
AHEAD = 2  # jobs a thread of a foreign cluster has waiting; our own workers get the next when they are done
ASK_AGAIN_S = 10.0  # after which workers may have come or gone
DEATHS = 1  # workers that may die of a log and it is tried once more
SETTINGS = {
    "distributed.scheduler.allowed-failures": DEATHS,
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    "distributed.admin.tick.limit": "1h",
    "distributed.deploy.lost-worker-timeout": "60s",  # for one that died to be back: a busy machine takes its time
    "distributed.comm.timeouts.connect": f"{PATIENCE_S:g}s",
}
LOST = "the connection to the scheduler was lost; what is finished is kept, and the same command goes on from there"


@dataclass(frozen=True)
class Wish:
    """scheduler: address of a cluster that is there, else workers processes here (None: a core each).

    memory_gb: of each worker, None for its share of the machine.
    """

    scheduler: str | None = None
    workers: int | None = None
    memory_gb: float | None = None

    def processes(self, jobs: int) -> int:
        """How many processes a cluster of this machine has; never more than there are jobs."""
        return max(1, min(self.workers or len(os.sched_getaffinity(0)), jobs))

    def limit(self, jobs: int) -> float | None:
        """Bytes a log may take; None: what the worker of a foreign cluster says."""
        if self.memory_gb is not None:
            return self.memory_gb * GB
        return None if self.scheduler else per_worker(self.processes(jobs))


@dataclass
class Crew:
    """A connection to workers. ahead: jobs to have under way for each thread of them. mend: replaces lost workers."""

    client: Any
    ahead: int = 1
    mend: Callable[[], None] = lambda: None
    running: dict[Any, Job] = field(default_factory=dict)
    counted: int = 0
    asked: float = -math.inf

    @property
    def threads(self) -> int:
        """Threads of all workers; they may come and go, so it is asked now and then."""
        if time.monotonic() - self.asked > ASK_AGAIN_S:
            try:
                self.counted, self.asked = sum(self.client.nthreads().values()), time.monotonic()
            except OSError as error:
                raise DataError(LOST) from error
        return self.counted

    def outcomes(self, jobs: Iterable[Job]) -> Iterator[Outcome]:
        """Each job's outcome as it ends; once the results cannot be written no further job begins.

        Raises DataError where the workers are lost or cannot do the work.
        """
        watch = Watch(self.client, self.mend, lambda: self.client.cancel(list(self.running)))
        watch.start()
        try:
            yield from self._outcomes(jobs)
        except DataError as error:
            raise (DataError(NOBODY) if watch.gave_up else error) from error
        finally:
            watch.stop()

    def _outcomes(self, jobs: Iterable[Job]) -> Iterator[Outcome]:
        from distributed import as_completed

        waiting, running, ended = iter(jobs), self.running, as_completed([], loop=self.client.loop)

        def begin(count: int) -> None:
            for _, job in zip(range(count), waiting):
                future = self.client.submit(carried_out, job, pure=False, retries=0)
                running[future] = job
                ended.add(future)

        begin(max(1, self.ahead * self.threads))
        for future in ended:
            outcome = _outcome(future, running.pop(future))
            future.release()
            yield outcome
            if outcome.state is State.STORE:
                waiting = iter(())
            begin(max(0, max(1, self.ahead * self.threads) - len(running)))


def _outcome(future: Any, job: Job) -> Outcome:
    from concurrent.futures import CancelledError

    from distributed.scheduler import KilledWorker

    try:
        return future.result()  # type: ignore[no-any-return]
    except KilledWorker:
        reason = "its workers died one after the other: the log may need more memory than there is"
        return Outcome(job.source, State.FAILED, reason=reason)
    except (CancelledError, TimeoutError, OSError) as error:
        raise DataError(LOST) from error
    except Exception as error:
        raise DataError(f"the workers cannot do the work ({type(error).__name__}: {error})") from error


@contextmanager
def crew(wish: Wish, jobs: int) -> Iterator[Crew]:
    """Workers while the block runs. jobs: how many there are to do; more workers than that are not started."""
    import dask

    _hush()
    with dask.config.set(SETTINGS):
        if wish.scheduler:
            yield from _foreign(wish.scheduler)
        else:
            yield from _own(wish, jobs)


def _hush() -> None:
    """Keep what Dask logs to itself: what matters is said in a line of ours."""
    import distributed  # its loggers are there, and their levels set, once it is imported

    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] == distributed.__name__]
    for name in (*names, "asyncio", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)


def _foreign(address: str) -> Iterator[Crew]:
    from distributed import Client

    try:
        client = Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise DataError(f"no scheduler answers at {address}") from error
    except ValueError as error:
        raise DataError(f"{address} is no address of a scheduler, such as tcp://host:8786 ({error})") from error
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
        yield Crew(client, AHEAD)
    except TimeoutError as error:
        raise DataError(f"the scheduler at {address} has no workers") from error
    finally:
        with suppress(Exception):
            client.close(timeout=CLOSING_S)


def _own(wish: Wish, jobs: int) -> Iterator[Crew]:
    from distributed import Client, LocalCluster

    cluster = None
    try:
        cluster = LocalCluster(
            n_workers=wish.processes(jobs),
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address=None,
            memory_limit=wish.limit(jobs) or 0,
            silence_logs=logging.CRITICAL + 1,
        )
        with Client(cluster, set_as_default=False) as client:
            client.register_plugin(deaf())
            yield Crew(client, mend=lambda: cluster.scale(len(cluster.worker_spec)))  # opens those that are missing
    except BaseException:
        _end_at_once()
        raise
    finally:
        with suppress(Exception):
            if cluster is not None:
                cluster.close(timeout=CLOSING_S)


def _end_at_once() -> None:
    """The workers are in the middle of a log, and would work on to its end before they heard of ours."""
    from distributed.deploy.spec import close_clusters

    atexit.unregister(close_clusters)  # it minds that a cluster has not even begun
    for child in multiprocessing.active_children():
        child.kill()


def deaf() -> Any:
    """Keeps workers from hearing an interrupt meant for the command: it ends them itself, without words."""
    from distributed import WorkerPlugin

    class Deaf(WorkerPlugin):  # type: ignore[misc]
        def setup(self, worker: Any) -> None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)

    return Deaf()


def limited(jobs: Sequence[Job], wish: Wish) -> Iterator[Job]:
    """The jobs with the memory each may take."""
    limit = wish.limit(len(jobs))
    return (replace(job, memory=limit) for job in jobs)


def carried_out(job: Job) -> Outcome:
    """What a worker is asked to call: what the work needs is imported there, never by the command."""
    from pipeline.archive.working import process

    return process(job)
