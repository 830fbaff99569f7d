"""Options of methods from the command line: they arrive, and what does not fit is told."""

import json

import pytest

from pipeline.settings import parsed


def test_values_are_read_as_in_toml_and_bare_words_are_text():
    given = parsed(
        ["mpf_weight=10", "network=printed", 'idam.x="a b"', "rvm.as_printed=true", "shape.limit=[1, 2.5, 3]"]
    )
    assert [(s.method, s.key, s.value) for s in given.given] == [
        ("", "mpf_weight", 10),
        ("", "network", "printed"),
        ("idam", "x", "a b"),
        ("rvm", "as_printed", True),
        ("shape", "limit", [1, 2.5, 3]),
    ]


def test_an_option_reaches_the_method_it_is_meant_for():
    given = parsed(["as_printed=true", "rvm.nodes=8"])
    idam, rvm = given.made("estimate", "idam"), given.made("identify", "rvm")
    assert (idam.as_printed, idam.mpf) == (True, True)
    assert (rvm.as_printed, rvm.nodes) == (False, 8)
    assert given.made("estimate", "smoother") is not None


def test_a_whole_number_serves_where_a_real_one_is_wanted():
    assert parsed(["mpf_weight=10"]).made("estimate", "idam").mpf_weight == 10.0


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("as_printed", "KEY=VALUE"),
        ("as_printed=maybe", "true or false"),
        ("as_printed=1", "true or false"),
        ("mpf_weight=heavy", "like 100.0"),
        ("nonsense=1", "mpf_weight"),
        ("td-ma.network=none", "no method that runs here"),
    ],
)
def test_what_does_not_fit_is_told_with_what_does(word, told):
    with pytest.raises(ValueError, match=told):
        parsed([word]).check([("estimate", "idam"), ("identify", "rvm")])


def test_a_value_the_method_refuses_is_told_with_its_name():
    with pytest.raises(ValueError, match="td-ma: 'sideways'"):
        parsed(["coarse=sideways"]).check([("estimate", "td-ma")])


def test_the_command_line_tells_wrong_options_with_status_2(deckflex, sample):
    told = deckflex("run", sample, "--estimator", "idam", "--set", "nonsense=1")
    assert told.status == 2
    assert "as_printed" in told.err


def test_the_printed_form_of_idam_is_reached_and_breaks_down(deckflex, sample):
    told = deckflex("run", sample, "--estimator", "idam", "--set", "as_printed=true", "--identifier", "whittle")
    assert told.status == 1
    assert "broke down" in told.err


def test_each_estimator_goes_with_its_own_identifier_and_says_which(deckflex, sample):
    told = deckflex("compare", sample, "--estimator", "smoother", "--estimator", "svram", "--json")
    assert told.status == 0, told.err
    found = {one["estimator"]: one["identifier"] for one in json.loads(told.out)["estimators"]}
    assert found == {"smoother": "whittle", "svram": "svr"}


def test_an_identifier_that_is_named_serves_all(deckflex, sample):
    told = deckflex("compare", sample, "--estimator", "svram", "--estimator", "td-ma", "--identifier", "acf", "--json")
    assert told.status == 0, told.err
    assert {one["identifier"] for one in json.loads(told.out)["estimators"]} == {"acf"}


def test_options_stand_in_the_provenance(deckflex, sample, tmp_path):
    from schemas.wire import scan_log

    told = deckflex("run", sample, "-o", tmp_path / "out.mcap", "--estimator", "td-ma", "--set", "coarse=integrals")
    assert told.status == 0, told.err
    assert "coarse=integrals" in str(scan_log(tmp_path / "out.mcap").metadata)
