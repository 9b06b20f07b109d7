"""Which effects a spectrum has: forward by score, then likelihood ratio, backward and swap moves.

A model's worth is ``2 l - sum of the prices of its effects``; an effect enters, stays and replaces
another only where that grows.  The prices hold false effects on white noise under 1 % of channels
(``docs/study_identify.md``): they are paid for searching a frequency or a correlation time too.
"""

from __future__ import annotations

import numpy as np

from imu_noise_id.effects.averaging import Averaging
from imu_noise_id.effects.bandwidth_limit import BandwidthLimit, DigitalBandwidthLimit
from imu_noise_id.effects.base import Effect, ResponseEffect, StochasticEffect
from imu_noise_id.effects.bias_instability import BiasInstability
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.effects.quantization import Quantization
from imu_noise_id.effects.rate_random_walk import RateRandomWalk
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.ordinates import LINEAR_WIDTH_HZ, Ordinates
from imu_noise_id.recording import Floats
from imu_noise_id.whittle import Fit, fit, log_covariance, log_likelihood

PRICE = {
    "white_noise": 10.0,
    "quantization": 10.0,
    "bias_instability": 10.0,
    "rate_random_walk": 10.0,
    "gauss_markov": 15.0,
    "narrow_band": 22.0,
    "averaging": 12.0,
    "bandwidth_limit": 18.0,
}
MOST = {"gauss_markov": 3, "narrow_band": 5}
STRENGTHS = ("density", "coefficient", "sigma")
LEAST_GAIN = 0.1
SLOW: tuple[type[StochasticEffect], ...] = (RateRandomWalk, BiasInstability, GaussMarkov)
SMOOTH: tuple[type[StochasticEffect], ...] = (*SLOW, Quantization, WhiteNoise)
SOURCES: tuple[type[StochasticEffect], ...] = (*SMOOTH, NarrowBand)
RESPONSES: tuple[type[ResponseEffect], ...] = (
    Averaging,
    BandwidthLimit,
    DigitalBandwidthLimit,
)
LEAST_EFFECTS = 1


def worth(candidate: Fit) -> float:
    """Return 2 l minus the prices of the effects."""
    return 2.0 * candidate.log_likelihood - sum(price(e) for e in candidate.effects)


def price(effect: Effect) -> float:
    """Price of an effect: a band narrower than a bin was sought at more frequencies than bins."""
    if not isinstance(effect, NarrowBand):
        return PRICE[effect.name]
    places = max(LINEAR_WIDTH_HZ / effect.bandwidth_hz, 1.0)
    return PRICE[effect.name] + 2.0 * float(np.log(places))


def white_start(ordinates: Ordinates) -> WhiteNoise:
    """White noise at the median ordinate, which no slow effect reaches."""
    order = np.argsort(ordinates.power)
    reached = np.cumsum(ordinates.dof[order])
    middle = order[np.searchsorted(reached, 0.5 * reached[-1])]
    return WhiteNoise(float(np.sqrt(max(ordinates.power[middle], np.finfo(float).tiny))))


def select(
    ordinates: Ordinates,
    floor: float = 0.0,
    start: tuple[Effect, ...] = (),
    sources: tuple[type[StochasticEffect], ...] = SOURCES,
) -> Fit:
    """Choose the effects of a spectrum and fit them.

    Parameters
    ----------
    ordinates : Ordinates
    floor : float
        Known white spectrum beneath everything.
    start : tuple of Effect
        Where the search begins; white noise when empty.
    sources : tuple of type
        Kinds that may be added.

    Returns
    -------
    Fit
    """
    best = fit(start or (white_start(ordinates),), ordinates, floor)
    for _ in range(20):
        grown = _grow(best, sources)
        if worth(grown) <= worth(best) + LEAST_GAIN:
            grown = _swap(best)
        if worth(grown) <= worth(best) + LEAST_GAIN:
            break
        best = prune(grown)
    return fit(best.effects, ordinates, floor)


def _may_have(effects: tuple[Effect, ...], kind: type[StochasticEffect]) -> bool:
    return sum(e.name == kind.name for e in effects) < MOST.get(kind.name, 1)


def _grow(current: Fit, sources: tuple[type[StochasticEffect], ...]) -> Fit:
    """Best fit with one effect more, or the current one."""
    residual = current.residual
    starts: list[Effect] = [
        start
        for kind in sources
        if _may_have(current.effects, kind)
        for start in kind.starts(residual)
    ]
    if not any(isinstance(e, ResponseEffect) for e in current.effects):
        starts += _response_starts(current)
    return max([current, *(_refit(current, (*current.effects, s)) for s in starts)], key=worth)


def _response_starts(current: Fit) -> list[ResponseEffect]:
    """The two most promising responses of each kind, level refitted in closed form."""
    found: list[ResponseEffect] = []
    ordinates = current.ordinates
    for kind in RESPONSES:
        ranked: list[tuple[float, ResponseEffect]] = []
        for start in kind.starts(current.residual):
            psd = _shaped(current, start)
            level = float(ordinates.dof @ (ordinates.power / psd) / ordinates.dof.sum())
            gain = log_likelihood(level * psd, ordinates) - current.log_likelihood
            ranked.append((gain, start))
        ranked.sort(key=lambda item: -item[0])
        found += [start for gain, start in ranked[:2] if gain > -5.0]
    return found


def _shaped(current: Fit, response: ResponseEffect) -> Floats:
    f, dt = current.ordinates.frequency_hz, current.ordinates.sample_time_s
    return (current.spectrum.psd - current.floor) * response.power_response(f, dt) + current.floor


def _refit(current: Fit, effects: tuple[Effect, ...]) -> Fit:
    return fit(effects, current.ordinates, current.floor, rough=True)


def _without(current: Fit, index: int) -> tuple[Effect, ...]:
    return current.effects[:index] + current.effects[index + 1 :]


def prune(current: Fit, kinds: tuple[type[Effect], ...] = (Effect,)) -> Fit:
    """Leave out, one at a time, what of the kinds is not worth its price."""
    while len(current.effects) > LEAST_EFFECTS:
        fewer = [
            _refit(current, _without(current, i))
            for i, sure in enumerate(_beyond_doubt(current))
            if not sure and isinstance(current.effects[i], kinds) and _leaves_a_source(current, i)
        ]
        if not fewer:
            break
        best = max(fewer, key=worth)
        if worth(best) < worth(current):
            break
        current = best
    return current


def _beyond_doubt(current: Fit) -> list[bool]:
    """Whether each effect's strength is known far better than its price asks (Wald's test)."""
    covariance = log_covariance(current)
    out, used = [], 0
    for effect in current.effects:
        free = effect.free()
        at = [used + i for i, name in enumerate(free) if name in STRENGTHS]
        used += len(free)
        known = min((4.0 * covariance[i, i] for i in at), default=np.inf)
        out.append(bool(known * 4.0 * price(effect) < 1.0))
    return out


def _leaves_a_source(current: Fit, index: int) -> bool:
    return any(isinstance(e, StochasticEffect) for e in _without(current, index))


def _swap(current: Fit) -> Fit:
    """Best fit with one effect exchanged for another kind, or the current one."""
    trials = [current]
    for i, effect in enumerate(current.effects):
        if not isinstance(effect, SMOOTH) or isinstance(effect, WhiteNoise):
            continue
        rest = _rest(current, i)
        for kind in SMOOTH:
            if kind.name == effect.name or not _may_have(rest.effects, kind):
                continue
            trials += [_refit(current, (*rest.effects, s)) for s in kind.starts(rest.residual)]
    return max(trials, key=worth)


def _rest(current: Fit, index: int) -> Fit:
    """Fit without one effect; white noise in its place where no source would be left."""
    if _leaves_a_source(current, index):
        return _refit(current, _without(current, index))
    return _refit(current, (*_without(current, index), white_start(current.ordinates)))
