"""What a twin states already is not news."""

import pytest

from schemas.diagnosis import Finding, ParameterEstimate
from stages.diagnose import diagnose
from stages.diagnose.stated import news
from tests.stages.diagnose import simulated
from twin import effects, parse_twin, with_run

TWIN = with_run(simulated.TWIN, duration=120.0)


def stating(*given):
    return parse_twin(simulated.augmented_twin(TWIN, [effects.build(name, parameters) for name, parameters in given]))


def found(name, **parameters):
    estimates = {
        key: {axis: ParameterEstimate(*item, "1") for axis, item in value.items()}
        if isinstance(value, dict)
        else ParameterEstimate(*value, "1")
        for key, value in parameters.items()
    }
    return Finding(name=name, parameters=estimates, evidence_nats=100.0)


@pytest.mark.parametrize(
    ("finding", "stated", "new"),
    [
        (found("gyro_random_walk", arw=(0.0031, 1e-4)), ("gyro_random_walk", {"arw": 0.003}), False),
        (found("gyro_random_walk", arw=(0.006, 1e-4)), ("gyro_random_walk", {"arw": 0.003}), True),
        (found("gyro_random_walk", arw=(0.003, 1e-4)), ("gyro_bias", {"x": 1.0}), True),
        (found("sample_dropout", rate=(0.6, 0.07), length=(3.0, 0.1)), ("sample_dropout", {"rate": 0.1}), True),
        (
            found("flexure_parameters", damping={"x": (0.2, 0.01), "y": (0.5, 0.01)}),
            ("flexure_parameters", {"damping": [0.2, None, None]}),
            False,
        ),
        (
            found("narrowband_vibration", axis=("y", None), frequency=(8.0, 0.01)),
            ("narrowband_vibration", {"axis": "z", "frequency": 8.0, "amplitude": 0.1}),
            True,
        ),
    ],
)
def test_what_is_stated_with_other_parameters_is_news(finding, stated, new):
    assert bool(news([finding], stating(stated))) is new


def test_losses_that_the_twin_states_are_no_gap():
    lost = simulated.log(("sample_dropout", {"rate": 0.6, "length": 3}), of=TWIN)
    library = ("sample_dropout", "time_delay")

    def named(twin):
        return [finding.name for finding in diagnose(lost, twin, shrink=False, library=library).effects]

    assert named(TWIN) == ["sample_dropout"]
    assert named(stating(("sample_dropout", {"rate": 0.6, "length": 3}))) == []
