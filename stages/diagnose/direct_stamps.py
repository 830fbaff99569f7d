"""Stamps of the sub-IMU: jitter about the best line, runs of lost samples, and jitter that the stamps hide."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from physics.units import NS
from schemas.diagnosis import Finding, ParameterEstimate, Place
from schemas.rig import FloatArray
from schemas.trial import ImuSeries, IntArray, Trial

LEAST_JITTER_S = 5e-6  # s: stamps rounded to 10 microseconds scatter by less
MORE_THAN_MAIN = 2.0  # times the main IMU's jitter, below which the recorder is to blame
LINE_S = 30.0  # s over which the line that stamps scatter about may bend
UNEVEN, UNEVEN_SHARE = 0.25, 0.2  # intervals off, and share of the stamps, from which jitter is as large as they
SAME_RATE = 0.01  # by which the mean rate may then differ from the main IMU's
SORTED_FROM = 0.1  # of the sample interval: beyond, sorting has narrowed the scatter
BACKGROUND_GAPS = 1.0  # gaps of any log, whatever its length
LONGEST_GAP = 500.0  # samples: gaps of an ordinary log are of any length up to this, evenly in logarithm
SAME_LENGTH = 0.9  # chance that a run of lost samples has the length of all
BLOCK_S = 10.0  # s within which the variance of hidden jitter follows the ship's rate
MOST_NATS = 1e6  # enough
JITTER_NATS = 14.0  # beyond which hidden jitter is believed

BoolArray = NDArray[np.bool_]


def index_of(stamp: IntArray, nominal: float = 0.0) -> IntArray:
    """Which sample (n,) of an uninterrupted record each one is. nominal: ns, the interval of the other unit, which
    tells jitter as large as the interval from gaps."""
    step = np.diff(stamp)
    period = float(np.median(step))
    rough = np.mean(np.abs(step / period - 1.0) > UNEVEN) > UNEVEN_SHARE
    if rough and abs(float(step.mean()) - nominal) < SAME_RATE * nominal:
        return np.arange(len(stamp))
    missing = np.maximum(np.rint(step / period).astype(np.int64), 1)
    # A late stamp before an early one is no gap: what a long step has too much, the ones beside it have too little.
    near = np.convolve(step / period - 1.0, np.ones(3), "same")
    lost = np.where((missing > 1) & (near > 0.5), missing, 1)
    return np.concatenate([[0], np.cumsum(lost)])


def interval_of(series: ImuSeries) -> float:
    """Median distance of the stamps, ns."""
    return float(np.median(np.diff(series.stamp)))


def line(stamp: IntArray, nominal: float = 0.0) -> FloatArray:
    """Instants (n,) ns from the first stamp on the line the stamps scatter about: straight over LINE_S at a time."""
    index, t = index_of(stamp, nominal), (stamp - stamp[0]).astype(float)
    slope, offset = np.polyfit(index, t, 1)
    rest = t - offset - slope * index
    nodes = max(2, int(t[-1] * NS / LINE_S) + 1)
    knots = np.linspace(0.0, float(index[-1]), nodes)
    place = np.clip(np.searchsorted(knots, index, side="right") - 1, 0, nodes - 2)
    share = (index - knots[place]) / (knots[1] - knots[0])
    matrix = np.zeros((nodes, nodes))
    right = np.zeros(nodes)
    for (a, wa), (b, wb) in _pairs(place, share):
        np.add.at(matrix, (a, b), wa * wb)
    for a, wa in ((place, 1.0 - share), (place + 1, share)):
        np.add.at(right, a, wa * rest)
    bend = np.linalg.solve(matrix + 1e-9 * np.eye(nodes), right)
    return np.asarray(offset + slope * index + bend[place] * (1.0 - share) + bend[place + 1] * share)


def _pairs(place: IntArray, share: FloatArray) -> list[tuple[tuple[IntArray, FloatArray], tuple[IntArray, FloatArray]]]:
    ends = [(place, 1.0 - share), (place + 1, share)]
    return [(one, other) for one in ends for other in ends]


def even(stamp: IntArray, nominal: float = 0.0) -> IntArray:
    """Stamps (n,) ns on their line."""
    return np.asarray(stamp[0] + np.rint(line(stamp, nominal)).astype(np.int64))


def scatter(stamp: IntArray, nominal: float = 0.0) -> float:
    """Standard deviation of stamps about their line, s."""
    return float(np.std((stamp - stamp[0]) - line(stamp, nominal))) * NS


def jitter(trial: Trial) -> Finding | None:
    """``timestamp_jitter`` where the sub-IMU's stamps scatter and the main IMU's do not."""
    nominal = interval_of(trial.main)
    sub, main = scatter(trial.sub.stamp, nominal), scatter(trial.main.stamp)
    least = max(LEAST_JITTER_S, MORE_THAN_MAIN * main)
    if sub < least:
        return None
    n, interval = len(trial.sub), float(np.mean(np.diff(trial.sub.stamp))) * NS
    std = _unsorted(sub, interval)
    # Gaussian stamps of this scatter against the least that counts
    evidence = n * (0.5 * (sub / least) ** 2 - 0.5 - np.log(sub / least)) + 0.5 * n * (1.0 - (least / sub) ** 2)
    evidence = min(float(evidence), MOST_NATS)
    parameters = {"std": ParameterEstimate(std, std / float(np.sqrt(2.0 * n)) * (std / sub), "s")}
    place = Place("sub.stamp", "", (0.0, 0.5 / interval), None, evidence)
    return Finding("timestamp_jitter", parameters, evidence, places=(place,))


def _unsorted(seen: float, interval: float) -> float:
    """Jitter whose stamps, put in order, scatter by ``seen``, s."""
    if seen < SORTED_FROM * interval:
        return seen
    draw, grid = np.random.default_rng(0).standard_normal(20_000), np.arange(20_000)
    tried = np.geomspace(0.05, 20.0, 60)
    narrowed = [float(np.std(np.sort(grid + size * draw) - grid)) for size in tried]
    return float(np.interp(seen / interval, narrowed, tried) * interval)


def gaps(series: ImuSeries, nominal: float = 0.0) -> tuple[FloatArray, IntArray]:
    """Begin (k,) s and samples lost (k,) of the gaps of a unit."""
    step = np.diff(index_of(series.stamp, nominal))
    where = np.flatnonzero(step > 1)
    return np.asarray(series.stamp[where] * NS, dtype=float), (step[where] - 1).astype(np.int64)


def dropout(trial: Trial) -> Finding | None:
    """``sample_dropout``: more gaps than an ordinary log has, or gaps of one length."""
    begin, length = gaps(trial.sub, interval_of(trial.main))
    if not len(begin):
        return None
    theirs, _ = gaps(trial.main)
    interval = interval_of(trial.sub) * NS
    if len(theirs):  # a gap of both is the recorder's
        alone = np.abs(begin[:, None] - theirs[None, :]).min(axis=1) > 1.5 * interval
        begin, length = begin[alone], length[alone]
    if not len(begin):
        return None
    duration = float(trial.sub.stamp[-1] - trial.sub.stamp[0]) * NS
    usual = int(np.bincount(length).argmax())
    evidence = _gap_nats(length, usual, BACKGROUND_GAPS + len(theirs))
    count = len(begin)
    # Runs that overlap or touch look like one longer run
    rate = count / (duration - float(length.sum()) * interval)
    parameters = {
        "rate": ParameterEstimate(rate, float(np.sqrt(count)) / duration, "1/s"),
        "length": ParameterEstimate(float(usual), 0.5 if np.mean(length == usual) < 0.5 else 0.0, "samples"),
    }
    place = Place("sub.stamp", "", (0.0, 0.5 / interval), None, evidence)
    finding = Finding("sample_dropout", parameters, evidence, places=(place,))
    return finding if evidence > 0.0 else None


def _gap_nats(length: IntArray, usual: int, background: float) -> float:
    """Runs of one length at a rate of their own, against a few gaps of any length."""
    count = len(length)
    # Of a Poisson number, ln p(count | count) - ln p(count | background).
    number = count * np.log(count / background) - (count - background) if count > background else 0.0
    ordinary = -np.log(np.maximum(length, 1) * np.log(LONGEST_GAP))
    alike = np.where(length == usual, np.log(SAME_LENGTH), np.log(1.0 - SAME_LENGTH) + ordinary)
    gain = alike - ordinary
    return number + float(gain.sum() - gain.max()) if count > 1 else 0.0


def hidden_jitter(trial: Trial) -> Finding | None:
    """``timestamp_jitter`` that even stamps hide: noise of the gyros that grows with how fast the rate changes.

    The fourth differences of the rates leave the noise; their squares are regressed on the square of the change of the
    main IMU's rate within blocks of BLOCK_S, so that neither a sea that grows nor an event of the sub-IMU's makes any.
    """
    turn = _acceleration(trial)
    evidence, std = _follows(trial.sub, turn)
    if evidence - max(_follows(trial.main, turn)[0], 0.0) < JITTER_NATS or std < LEAST_JITTER_S:
        return None
    interval = interval_of(trial.sub) * NS
    parameters = {"std": ParameterEstimate(std, std / float(np.sqrt(2.0 * max(evidence, 1.0))), "s")}
    place = Place("sub.gyro", "", (0.2 / interval, 0.5 / interval), None, evidence)
    return Finding("timestamp_jitter", parameters, evidence, places=(place,))


def _acceleration(trial: Trial) -> tuple[int, FloatArray, FloatArray]:
    """A stamp, times (n,) ns since it, square of the ship's angular acceleration (n,), rad^2/s^4, smooth over 0.2 s."""
    main = trial.main
    half = max(1, int(0.1 / (interval_of(main) * NS)))
    change = (main.gyro[2 * half :] - main.gyro[: -2 * half]) / (2.0 * half * interval_of(main) * NS)
    since = (main.stamp[half:-half] - main.stamp[0]).astype(float)
    return int(main.stamp[0]), since, np.asarray((change**2).sum(axis=1))


def _follows(series: ImuSeries, turn: tuple[int, FloatArray, FloatArray]) -> tuple[float, float]:
    """Nats for noise in proportion to the ship's angular acceleration, and the jitter in s."""
    whole = np.convolve(np.diff(index_of(series.stamp)) > 1, np.ones(9), "same")[2:-1] < 0.5
    rough = (np.diff(series.gyro, 4, axis=0) ** 2).sum(axis=1) / 70.0  # white noise keeps its variance
    squared = np.interp((series.stamp[2:-2] - turn[0]).astype(float), turn[1], turn[2])
    block, clock = max(int(BLOCK_S / (interval_of(series) * NS)), 10), np.arange(len(rough))
    sums = np.zeros((2, 3))  # of odd and even blocks: robust and plain product, size
    for number, first in enumerate(range(0, len(rough) - block + 1, block)):
        keep = whole[first : first + block]
        y, x = rough[first : first + block][keep], squared[first : first + block][keep]
        level = float(np.median(y)) / 0.789 if len(y) >= block // 2 else 0.0  # of a sum of three squares
        if level <= 0.0:
            continue
        at = clock[first : first + block][keep]
        x = _level(x, at)
        precision = 0.5 / (level**2 * 2.0 / 3.0)  # neighbours share differences
        robust, plain = float(x @ _level(np.minimum(y, 4.0 * level), at)), float(x @ _level(y, at))
        sums[number % 2] += np.array([robust, plain, float(x @ x)]) * precision
    product, plain, size = sums[:, 0], sums[:, 1].sum(), sums[:, 2]
    if size.min() <= 0.0 or product.min() <= 0.0 or plain <= 0.0:
        return 0.0, 0.0
    # What the odd blocks say, on the even ones, and the other way round
    variance = (product / size)[::-1]
    return float(np.sum(variance * product - 0.5 * variance**2 * size)), float(np.sqrt(plain / size.sum()))


def _level(values: FloatArray, at: IntArray) -> FloatArray:
    """Values (n,) without their mean and trend: a ship that gets under way bends more and turns more, too."""
    centred = at - at.mean()
    return np.asarray(values - values.mean() - centred * (centred @ values) / (centred @ centred))
