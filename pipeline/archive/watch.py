"""Whether any worker is there: those that Dask has given up are replaced, and a batch that nobody works on ends.

Dask starts a worker that died again, but gives it up where that takes too long (a busy machine) or where it dies while
it starts; jobs then wait for ever, without a word.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

LOOK_S = 10.0
NOBODY_S = 180.0  # without a single worker, until a batch is ended
NOBODY = "no worker is left and none comes; what is finished is kept, and the same command goes on from there"


class Watch(threading.Thread):
    """Looks at the workers of a client now and then. mend: called at each look. give_up: once, when none comes."""

    def __init__(self, client: Any, mend: Callable[[], None], give_up: Callable[[], None]) -> None:
        super().__init__(daemon=True)
        self.client, self.mend, self.give_up = client, mend, give_up
        self.over = threading.Event()
        self.seen = time.monotonic()
        self.gave_up = False

    def run(self) -> None:
        """Until :meth:`stop`, or until it gives up."""
        while not (self.gave_up or self.over.wait(LOOK_S)):
            self.look(time.monotonic())

    def stop(self) -> None:
        """No further look."""
        self.over.set()

    def look(self, now: float) -> None:
        """Once. now: s, of the monotonic clock."""
        try:
            there = len(self.client.nthreads())
            self.mend()
        except Exception:  # a scheduler that is gone is noticed where its answers are waited for
            return
        self.seen = now if there else self.seen
        if now - self.seen > NOBODY_S:
            self.gave_up = True
            self.give_up()
