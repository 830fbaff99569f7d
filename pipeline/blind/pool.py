"""Work spread over processes, with progress; one worker works here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import TypeVar

Progress = Callable[[str, int, int], None]
Job = TypeVar("Job")
Outcome = TypeVar("Outcome")


def each(
    work: Callable[[Job], Outcome], jobs: Sequence[Job], workers: int, step: str, progress: Progress | None = None
) -> list[Outcome]:
    """``work`` on every job, in the order of the jobs; an exception of one ends all."""

    def tell(done: int) -> None:
        if progress is not None:
            progress(step, done, len(jobs))

    tell(0)
    if workers <= 1 or len(jobs) <= 1:
        out = []
        for done, job in enumerate(jobs, 1):
            out.append(work(job))
            tell(done)
        return out
    with ProcessPoolExecutor(min(workers, len(jobs)), mp_context=get_context("spawn")) as pool:
        futures = [pool.submit(work, job) for job in jobs]
        try:
            for done, future in enumerate(as_completed(futures), 1):
                future.result()
                tell(done)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
        return [future.result() for future in futures]
