"""Exit status 2 and a hint for wrong usage; help with an example for every command."""

import pytest

from pipeline.cli import app
from pipeline.registries import Kind, listing

COMMANDS = (
    "simulate", "info", "run", "compare", "diagnose", "reproduce", "batch", "catalogue", "list", "view", "version",
)  # fmt: skip


def test_the_commands_are_those_of_this_version(deckflex):
    names = [command.name or command.callback.__name__ for command in app.registered_commands]
    assert sorted(names) == sorted(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_help_has_an_example(deckflex, command):
    told = deckflex(command, "--help")
    assert told.status == 0
    assert f"deckflex {command}" in told.out.split("Example:")[1]


@pytest.mark.parametrize(
    "arguments",
    [
        ["run"],
        ["run", "a.mcap", "--no-such-option"],
        ["run", "a.mcap", "--rrd-rate", "-1"],
        ["compare", "a.mcap"],
        ["list", "elephants"],
        ["simulate", "sample", "--duration", "soon"],
        ["diagnose", "a.mcap"],
    ],
)
def test_wrong_usage_is_status_2_with_a_hint(deckflex, arguments):
    told = deckflex(*arguments)
    assert told.status == 2
    assert told.out == ""
    assert "Usage" in told.err


@pytest.mark.parametrize("option", ["--estimator", "--identifier", "--shape"])
def test_an_unknown_method_is_wrong_usage_and_the_known_ones_are_told(deckflex, sample, option):
    kind = {"--estimator": Kind.ESTIMATORS, "--identifier": Kind.IDENTIFIERS, "--shape": Kind.SHAPES}[option]
    told = deckflex("run", sample, option, "nonsense")
    assert told.status == 2
    assert all(entry.name in told.err for entry in listing(kind))


@pytest.mark.parametrize("kind", list(Kind))
def test_what_can_be_listed_is_listed(deckflex, kind):
    told = deckflex("list", kind)
    assert told.status == 0
    assert all(entry.name in told.out for entry in listing(kind))


@pytest.mark.parametrize("kind", [Kind.ESTIMATORS, Kind.IDENTIFIERS, Kind.SHAPES, Kind.TWINS, Kind.EFFECTS])
def test_every_listed_thing_says_what_it_is(kind):
    assert listing(kind)
    assert all(entry.about for entry in listing(kind))


def test_the_version_is_that_of_the_package(deckflex):
    from importlib.metadata import version

    assert deckflex("version").out.strip() == version("deckflex")
