"""What a batch has to do: logs that are done are known by names alone, the others become jobs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pipeline.archive.config import Config, key_of
from pipeline.archive.jobs import Job
from pipeline.archive.manifest import ASIDE, DONE, Manifest, load_manifest, marks_of
from pipeline.archive.source import Source
from pipeline.archive.sources import found_in
from pipeline.archive.stores import Store


@dataclass(frozen=True)
class Plan:
    """jobs: logs to work on. done: logs with a result. aside: logs set aside before, with the keys of their entries.

    same: logs with the content of another one that is to be worked on. unreadable: (name, reason). notes: sentences.
    """

    jobs: tuple[Job, ...] = ()
    done: tuple[Source, ...] = ()
    aside: tuple[tuple[Source, str], ...] = ()
    same: tuple[Source, ...] = ()
    unreadable: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def logs(self) -> int:
        """How many logs there are in all."""
        return sum(map(len, (self.jobs, self.done, self.aside, self.same, self.unreadable)))


def planned(words: Sequence[str], store: Store, config: Config, *, retry: bool = False, rehash: bool = False) -> Plan:
    """Look at names only. retry: also what was set aside before. rehash: trust no earlier look at a log's content.

    Raises DataError where a word names no log, or the store cannot be read.
    """
    found = found_in(words, store.root)
    manifest = load_manifest(store)
    if rehash:
        manifest = Manifest(manifest.states, {}, manifest.marks)
    plan = Plan(unreadable=found.unreadable, notes=found.notes)
    jobs: dict[str, Job] = {}
    done, aside, same = [], [], []
    for source in found.sources:
        sha256 = manifest.sha256_of(source)
        key = key_of(sha256, config) if sha256 else ""
        state = manifest.states.get(key)
        if state == DONE:
            done.append(source)
        elif state == ASIDE and not retry:
            aside.append((source, key))
        elif key in jobs:
            same.append(source)
        else:
            marks = tuple(marks_of(manifest, source))
            jobs[key or source.address] = Job(source, config.document(), store.root, sha256, marks, retry=retry)
    return replace(plan, jobs=tuple(jobs.values()), done=tuple(done), aside=tuple(aside), same=tuple(same))
