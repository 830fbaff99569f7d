"""A diagnosis as one would come out of a log with a time delay in it, made from nothing."""

import numpy as np

from schemas.diagnosis import (
    Comparison,
    Diagnosis,
    Errors,
    Finding,
    Gap,
    Localisation,
    ParameterEstimate,
    Place,
    Spectrum,
    Tested,
    Trace,
    Transfer,
    Verdict,
)

START = 0.0
LENGTH = 1800.0
CHANNELS = ("sub.gyro", "sub.accel", "phins_sub.attitude")


def spectra(rng: np.random.Generator) -> tuple[Spectrum, ...]:
    f = np.geomspace(0.01, 5.0, 120)
    found = []
    for channel, unit in (("sub.gyro", "(rad/s)²/Hz"), ("sub.accel", "(m/s²)²/Hz")):
        for axis in "xyz":
            expected = 1e-9 / (1 + (f / 0.3) ** 2) + 1e-12
            noise = rng.chisquare(40, len(f)) / 40
            hump = 1 + (25.0 if axis == "x" else 3.0) * np.exp(-0.5 * (np.log(f / 0.12) / 0.3) ** 2)
            found.append(Spectrum(channel, axis, f, expected * noise * hump, expected * noise, expected, unit))
    return tuple(found)


def localisation(rng: np.random.Generator) -> Localisation:
    channels = tuple(f"{channel} {axis}" for channel in CHANNELS for axis in "xyz")
    bands = np.array([[0.0, 0.05], [0.05, 0.1], [0.1, 0.2], [0.2, 0.5], [0.5, 1.0], [1.0, 5.0]])
    edges = np.arange(START, START + LENGTH + 1.0, 30.0)
    score = rng.gamma(0.5, 1.0, (len(channels), len(bands), len(edges) - 1))
    score[0, 2] += 20.0 + 5.0 * rng.standard_normal(len(edges) - 1)
    return Localisation(channels, bands, edges, score)


def traces(rng: np.random.Generator) -> tuple[Trace, ...]:
    t = np.arange(START, START + LENGTH, 0.1)
    regressor = 2.0 * np.sin(2 * np.pi * t / 9.0) * (1 + 0.4 * np.sin(2 * np.pi * t / 200.0))
    good = (t < 700.0) | (t > 730.0)
    after = rng.standard_normal(len(t))
    return tuple(
        Trace("sub.gyro", axis, t, after + share * regressor, after, share * regressor, good)
        for axis, share in (("x", 1.0), ("y", 0.4))
    )


def ranked() -> tuple[Tested, ...]:
    rows = [("time_delay", 5210.0, True, ""), ("phins_latency", 2890.0, False, "explained by time_delay")]
    rows += [
        ("clock_drift", 610.0, False, "explained by time_delay"),
        ("gyro_bandwidth", 12.0, False, "below threshold"),
    ]
    rows += [(name, float(v), False, "below threshold") for name, v in (("lever_arm", 3.1), ("heel_bending", -1.2))]
    found = [Tested(name, nats, 14.0, named, why) for name, nats, named, why in rows]
    return (*found, Tested("gyro_temperature", None, 14.0, False, "the log has no temperature"))


def finding() -> Finding:
    return Finding(
        "time_delay",
        {
            "delay_s": ParameterEstimate(0.015302, 2.1e-5, "s"),
            "bias": {a: ParameterEstimate(v, 0.02, "deg/h") for a, v in zip("xyz", (0.1, -0.2, 0.05))},
            "axis": ParameterEstimate("x", None, ""),
        },
        5210.0,
        ("phins_latency",),
        ("a turn of the ship by 30 degrees or more",),
        (Place("sub.gyro", "x", (0.1, 0.2), None, 1203.0), Place("sub.gyro", "y", (0.1, 0.2), (300.0, 900.0), 310.0)),
        "Compensate the delay of the sub-IMU's stamps, or synchronise both clocks to one pulse per second.",
    )


def diagnosis(seed: int = 1, **changes: object) -> Diagnosis:
    rng = np.random.default_rng(seed)
    gap = Gap(1.42, 0.03, 0.98, (0.95, 0.99))
    base = {
        "log": "trial.mcap",
        "twin": "trial.twin.toml",
        "verdict": Verdict.EXPLAINED,
        "where": finding().places,
        "effects": (finding(),),
        "gap": gap,
        "augmented_twin": 'name = "trial"\n\n[[effect]]\nname = "time_delay"\ndelay_s = 0.0153\n',
        "advice": (finding().advice, "Repeat the trial with a turn of 30 degrees."),
        "rmse": Errors(*(np.array(v) for v in ([0.27, 0.25, 0.67], [0.05, 0.05, 0.11], [0.25, 0.25, 0.63],
                                               [0.06, 0.06, 0.11])), reference="PHINS"),
        "tested": ranked(),
        "untestable": {"gyro_temperature": "the log has no temperature"},
        "comparisons": (
            Comparison("runner-up", "phins_latency", Gap(1.42, 0.64, 0.55, (0.49, 0.60))),
            Comparison("placebo", "heel_bending", Gap(1.42, 1.42, 0.0, (0.0, 0.01))),
        ),
        "spectra": spectra(rng),
        "localisation": localisation(rng),
        "traces": traces(rng),
        "notes": ("a match shows consistency, not causation",),
        "duration_s": LENGTH,
    }  # fmt: skip
    return Diagnosis(**{**base, **changes})


def no_gap() -> Diagnosis:
    """Nothing was found, and nothing can be drawn."""
    empty = {"where": (), "effects": (), "rmse": None, "comparisons": (), "spectra": (), "traces": ()}
    gap, quiet = Gap(0.01, 0.01, 0.0, (0.0, 0.3)), tuple(Tested(name, 2.0, 14.0, False) for name in ("a", "b"))
    return diagnosis(verdict=Verdict.NO_GAP, gap=gap, localisation=None, advice=(), tested=quiet, **empty)


def unknown() -> Diagnosis:
    """A gap that nothing in the library explains."""
    low = tuple(Tested(name, 9.0, 14.0, False, "halves of the log disagree") for name in ("time_delay", "lever_arm"))
    gap = Gap(1.42, 1.42, 0.0, (0.0, 0.1))
    return diagnosis(verdict=Verdict.UNKNOWN_EFFECT, effects=(), gap=gap, tested=low, transfer=transfer())


def transfer() -> Transfer:
    """What has no name follows the roll rate, a little late."""
    frequency = np.geomspace(0.02, 0.5, 25)
    gain, phase = np.full(25, 2e-3), -2.0 * np.pi * 0.02 * frequency
    return Transfer("sub.gyro", "z", "main.gyro", "y", "1", frequency, gain, 0.1 * gain, phase, np.full(25, 0.1), 84.0)
