"""run --compensate: a diagnosis report turned into effects, and the estimate without them."""

import json

import numpy as np
import pytest

from pipeline.compensating import load_remedy
from schemas.errors import DataError
from tests.twin.effects.worlds import STRONG
from twin import dump_twin, effects, load_twin, make_twin, with_run
from twin.config import EffectSpec
from twin.effects._parameters import Parameter

ROUGH = with_run(load_twin("random-sea"), duration=240.0, seed=4)


def told(effect, name, value):
    """Values as a report gives them."""
    if isinstance(value, list | tuple):
        return {axis: told(effect, name, v) for axis, v in zip("xyz", value)}
    if isinstance(value, dict):
        return {axis: told(effect, name, v) for axis, v in value.items()}
    units: dict[str, Parameter] = {item.name: item for item in effect.parameters()}
    return {"value": value, "std": None, "unit": units[name].unit if name in units else ""}


def report(*named, twin=ROUGH, **changed):
    """A diagnosis report that names effects with their true parameters."""
    found = [
        {
            "name": name,
            "parameters": {k: told(effects.get(name), k, v) for k, v in given.items()},
            "evidence_nats": 99.0,
        }
        for name, given in named
    ]
    specs = tuple(EffectSpec(name=name, **given) for name, given in named)
    augmented = twin.model_copy(update={"effect": (*twin.effect, *specs)})
    return {"twin": "random-sea", "effects": found, "augmented_twin": dump_twin(augmented), **changed}


def written(folder, document):
    path = folder / "report.json"
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return path


@pytest.mark.parametrize("name", STRONG)
def test_every_effect_is_rebuilt_from_a_report(name: str, tmp_path) -> None:
    remedy = load_remedy(written(tmp_path, report((name, STRONG[name]))))
    assert remedy.effects == (effects.build(name, STRONG[name]),)
    assert remedy.twin == ROUGH


def test_the_twins_own_effects_stay_in_it(tmp_path) -> None:
    own = {"name": "time_delay", "delay": 0.002}
    twin = make_twin({"effect": [own]})
    remedy = load_remedy(written(tmp_path, report(("time_delay", {"delay": 0.01}), twin=twin)))
    assert remedy.twin == twin
    assert [effect.delay for effect in remedy.effects] == [0.01]


def test_the_augmented_twin_may_be_a_file_beside_the_report(tmp_path) -> None:
    document = report(("gyro_bias", {"x": 2.0}))
    (tmp_path / "augmented.toml").write_text(document["augmented_twin"])
    remedy = load_remedy(written(tmp_path, {**document, "augmented_twin": "augmented.toml"}))
    assert remedy.twin == ROUGH


def test_without_an_augmented_twin_the_twin_is_taken_by_name(tmp_path) -> None:
    remedy = load_remedy(written(tmp_path, report(("gyro_bias", {"x": 2.0}), augmented_twin=None)))
    assert remedy.twin == load_twin("random-sea")


@pytest.mark.parametrize(
    ("document", "line"),
    [
        ("not json", "the report is not a JSON document"),
        ("[1, 2]", "its JSON is not an object"),
        ({}, "it has no list 'effects'"),
        ({"effects": {"name": "outliers"}}, "it has no list 'effects'"),
        ({"effects": ["outliers"]}, "an effect of the report has no name"),
        ({"effects": [{"name": "outliers"}]}, "effect 'outliers' of the report has no parameters"),
        ({"effects": [{"name": "sea_snakes", "parameters": {}}]}, "there is no effect named 'sea_snakes'"),
        ({"effects": [{"name": "gyro_bias", "parameters": {"x": {"value": "much"}}}]}, "effect 'gyro_bias': 'x'"),
        ({"effects": [{"name": "gyro_bias", "parameters": {"w": {"value": 1.0}}}]}, "unknown parameter 'w'"),
        ({"effects": []}, "names no twin"),
        ({"effects": [], "twin": "no-such-twin"}, "there is no built-in twin named 'no-such-twin'"),
        ({"effects": [], "augmented_twin": "name = ["}, "not valid TOML"),
    ],
)
def test_a_bad_report_is_told_in_one_line(document, line: str, tmp_path) -> None:
    path = written(tmp_path, document)
    with pytest.raises(DataError, match=line) as error:
        load_remedy(path)
    assert error.value.file == str(path)
    assert "\n" not in str(error.value)


def test_a_missing_report_stops_the_command(sample, tmp_path, deckflex) -> None:
    told = deckflex("run", sample, "--compensate", tmp_path / "none.json")
    assert told.status == 1
    assert "none.json" in told.err
    assert told.err.count("\n") == 1


def test_the_summary_says_what_was_compensated(sample, tmp_path, deckflex) -> None:
    path = written(tmp_path, report(("accel_bias", {"x": 50.0}), twin=load_twin("sample")))
    document = json.loads(deckflex("run", sample, "--compensate", path, "--json").out)
    assert document["compensated"] == ["accel_bias: taken out of the log"]
    plain = deckflex("run", sample, "--compensate", path).out
    assert "compensated accel_bias: taken out of the log" in " ".join(plain.split())


def estimated(deckflex, log, *more):
    told = deckflex("run", log, "--json", *more)
    assert told.status == 0, told.err
    return np.array(json.loads(told.out)["rmse_arcmin"]["truth"])


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    from tests.pipeline.running import run_command

    folder = tmp_path_factory.mktemp("clean")
    (folder / "twin.toml").write_text(dump_twin(ROUGH))
    assert run_command("simulate", folder / "twin.toml", "-o", folder / "log.mcap").status == 0
    return estimated(run_command, folder / "log.mcap")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("gyro_scale_factor", {"x": 2000.0, "y": -1500.0, "z": 1000.0}),
        ("gyro_bandwidth", {"cutoff": 4.0}),
        ("outliers", {"rate": 30.0, "size": 0.05}),
        ("wave_forced_bending", {"x": 0.2, "z": 0.5}),
    ],
)
def test_the_estimate_is_as_good_as_without_the_effect(name, given, clean, tmp_path, deckflex) -> None:
    document = report((name, given))
    (tmp_path / "twin.toml").write_text(document["augmented_twin"])
    log = tmp_path / "log.mcap"
    assert deckflex("simulate", tmp_path / "twin.toml", "-o", log).status == 0
    before = estimated(deckflex, log)
    after = estimated(deckflex, log, "--compensate", written(tmp_path, document))
    assert np.linalg.norm(after) < 1.2 * np.linalg.norm(clean)
    # 0.02 arcmin: what seeds differ by; the estimator by itself resists outliers down to 0.03.
    assert np.abs(before - clean).max() > max(2.0 * np.abs(after - clean).max(), 0.02)
