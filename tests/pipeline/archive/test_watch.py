"""Lost workers are replaced, and a batch that nobody works on ends."""

from pipeline.archive.watch import NOBODY_S, Watch


class Client:
    """What a scheduler says: a worker each for so many looks, then none."""

    def __init__(self, looks: int) -> None:
        self.looks = looks

    def nthreads(self) -> dict[str, int]:
        self.looks -= 1
        if self.looks == -100:
            raise OSError
        return {"worker": 1} if self.looks >= 0 else {}


def watched(looks: int) -> tuple[Watch, list[str]]:
    told: list[str] = []
    return Watch(Client(looks), lambda: told.append("mended"), lambda: told.append("given up")), told


def test_it_gives_up_only_after_nobody_was_there_for_long():
    watch, told = watched(2)
    start = watch.seen
    for now in (10.0, 20.0, 20.0 + NOBODY_S):
        watch.look(start + now)
    assert told == ["mended"] * 3
    watch.look(start + 21.0 + NOBODY_S)
    assert told == ["mended"] * 4 + ["given up"]
    assert watch.gave_up


def test_a_scheduler_that_does_not_answer_is_not_its_business():
    watch, told = watched(-99)
    watch.look(watch.seen + 10 * NOBODY_S)
    assert told == []
    assert not watch.gave_up
