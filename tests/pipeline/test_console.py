import os
import signal

import pytest

from pipeline.console import BAD_DATA, INTERRUPTED, TERMINATED, display, emit, guarded
from pipeline.tables import plain_table
from schemas.errors import DataError


def failing(error):
    def command():
        raise error

    return command


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (
            DataError("is empty", file="a.mcap", channel="/imu/main", time_s=1.5),
            "a.mcap, /imu/main, t = 1.500 s: is empty",
        ),
        (OSError(28, "No space left on device"), "No space left on device"),
        (FileNotFoundError(2, "No such file or directory", "b.toml"), "b.toml: No such file or directory"),
        (MemoryError(), "out of memory; the log is too large for this machine"),
    ],
)
def test_an_error_is_one_line_and_status_1(capsys, error, line):
    assert guarded(failing(error), debug=False) == BAD_DATA
    assert capsys.readouterr() == ("", f"deckflex: {line}\n")


def test_an_unexpected_error_is_one_line_unless_debugging(capsys):
    assert guarded(failing(ZeroDivisionError("x\ny")), debug=False) == BAD_DATA
    told = capsys.readouterr().err
    assert told.startswith("deckflex: internal error: ZeroDivisionError: x y")
    assert told.count("\n") == 1
    guarded(failing(ZeroDivisionError("x")), debug=True)
    assert "Traceback" in capsys.readouterr().err


def test_names_from_a_log_cannot_write_lines_or_control_the_terminal(capsys):
    guarded(failing(DataError("bad", file="a\n\x1b[2Jb\u2028c")), debug=False)
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert told[:-1].isprintable()


def test_an_interrupt_and_a_polite_kill_unwind(capsys):
    unwound = []

    def killed():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            signal.pause()
        finally:
            unwound.append(True)

    assert guarded(failing(KeyboardInterrupt()), debug=False) == INTERRUPTED
    assert capsys.readouterr().err.count("\n") == 1
    assert guarded(killed, debug=False) == TERMINATED
    assert unwound


def test_json_holds_no_figure_that_json_does_not_know(capsys):
    emit({"a": 1.0, "b": None})
    assert capsys.readouterr().out == '{\n  "a": 1.0,\n  "b": null\n}\n'
    with pytest.raises(ValueError, match="JSON"):
        emit({"a": float("nan")})


@pytest.mark.parametrize("width", [30, 60, 200])
def test_no_figure_is_cut_on_a_narrow_terminal(monkeypatch, capsys, width):
    monkeypatch.setenv("COLUMNS", str(width))
    table = plain_table("topic", "messages", "rate [Hz]", "jitter [ms]", "longest gap [s]", "out of order")
    table.add_row("/imu/main/temperature", "10000", "100.000", "0.12345", "6.010", "17")
    display(table)
    told = capsys.readouterr().out
    for figure in ("10000", "100.000", "0.12345", "6.010", "17"):
        assert figure in told
    assert max(map(len, told.splitlines())) <= width
