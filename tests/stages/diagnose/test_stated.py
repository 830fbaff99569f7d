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
        (found("gyro_quantization", step=(0.31, 0.01)), ("gyro_quantization", {"step": 0.3}), False),
        (found("gyro_quantization", step=(0.6, 0.01)), ("gyro_quantization", {"step": 0.3}), True),
        (found("gyro_bias_instability", std=(8.0, 4.0)), ("gyro_bias_instability", {"std": 6.0, "tau": 60.0}), False),
        (found("gyro_bias_instability", std=(8.0, 4.0)), ("gyro_bias_instability", {"std": 1.0, "tau": 60.0}), True),
        (found("gyro_quantization", step=(0.3, 0.01)), ("gyro_bias", {"x": 1.0}), True),
        (found("time_delay", delay=(4e-3, 1e-5)), ("time_delay", {"delay": 4e-3}), True),  # as much again
        (found("sample_dropout", rate=(0.6, 0.07), length=(3.0, 0.1)), ("sample_dropout", {"rate": 0.1}), True),
        (
            found("second_mode", axis=("y", None), frequency=(8.0, 0.01)),
            ("second_mode", {"axis": "z", "frequency": 8.0, "damping": 0.2, "std_arcmin": 0.1}),
            True,
        ),
    ],
)
def test_what_is_stated_with_other_parameters_is_news(finding, stated, new):
    assert bool(news([finding], stating(stated))) is new


def test_of_a_delay_that_the_twin_states_in_part_the_rest_is_told():
    late = simulated.log(("time_delay", {"delay": 8e-3}), of=TWIN)
    told = diagnose(late, stating(("time_delay", {"delay": 5e-3})), shrink=False, library=("time_delay",)).effects
    assert [finding.name for finding in told] == ["time_delay"]
    delay = told[0].parameters["delay"]
    assert abs(delay.value - 3e-3) < 3.0 * delay.std + 2e-5


def test_a_lever_arm_that_the_twin_states_is_no_gap():
    arm = ("lever_arm", {"x": 0.1, "z": -0.05})
    told = diagnose(simulated.log(arm, of=TWIN), stating(arm), shrink=False, library=("lever_arm",))
    assert told.effects == ()


def test_losses_that_the_twin_states_are_no_gap():
    lost = simulated.log(("sample_dropout", {"rate": 0.6, "length": 3}), of=TWIN)
    library = ("sample_dropout", "time_delay")

    def named(twin):
        return [finding.name for finding in diagnose(lost, twin, shrink=False, library=library).effects]

    assert named(TWIN) == ["sample_dropout"]
    assert named(stating(("sample_dropout", {"rate": 0.6, "length": 3}))) == []
