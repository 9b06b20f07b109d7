"""Multirate filtering of one axis: an inertial sensor at its rate, an aid every so many samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_fusion.discretize import Step, repeated
from nav_fusion.kalman import Gaussian, correct_and_predict, predict, steady_covariance

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Chain:
    """A linear error model in two rates.

    Between aids x <- fast.F x + w, ``ratio`` times; at the aid y = H x + v and x <- aid_F x + u
    with E[v v'] = R, E[u u'] = aid_Q and E[u v'] = M: the aid's own state moves by the input that
    it shows.

    Attributes
    ----------
    fast : Step
    ratio : int
    H, R, aid_F, aid_Q, M : float64 arrays
    P0 : (n, n) float64
    names : tuple of str
        Of the states.
    """

    fast: Step
    ratio: int
    H: Floats
    R: Floats
    aid_F: Floats  # noqa: N815  (the textbook's letter)
    aid_Q: Floats  # noqa: N815
    M: Floats
    P0: Floats
    names: tuple[str, ...]

    @property
    def aid_period_s(self) -> float:
        """Time between aids."""
        return self.ratio * self.fast.dt_s

    def period(self) -> Step:
        """One aid period as a step, without correction."""
        fast = repeated(self.fast, self.ratio)
        return Step(fast.F @ self.aid_F, fast.F @ self.aid_Q @ fast.F.T + fast.Q, fast.dt_s)


@dataclass(frozen=True)
class CovarianceCourse:
    """Covariances before each aid: ``time_s`` (k,), ``covariance`` (k, n, n)."""

    time_s: Floats
    covariance: Floats

    def sigma(self, state: int) -> Floats:
        """Standard deviation of one state, (k,)."""
        return np.sqrt(self.covariance[:, state, state])


def run_covariance(chain: Chain, duration_s: float) -> CovarianceCourse:
    """Covariance over a duration, an aid first; the fast steps between two aids taken as one."""
    between = repeated(chain.fast, chain.ratio)
    aids = round(duration_s / chain.aid_period_s)
    state = Gaussian(np.zeros(len(chain.names)), chain.P0)
    nothing = np.zeros(chain.H.shape[0])
    covariances = np.zeros((aids + 1, *chain.P0.shape))
    covariances[0] = chain.P0
    for k in range(aids):
        state = correct_and_predict(
            state, nothing, chain.H, chain.R, chain.aid_F, chain.aid_Q, chain.M
        ).state
        state = predict(state, between.F, between.Q)
        covariances[k + 1] = state.covariance
    return CovarianceCourse(chain.aid_period_s * np.arange(aids + 1, dtype=np.float64), covariances)


def steady(chain: Chain) -> Floats:
    """Covariance before the aid in the steady state: the periodic Riccati equation.

    One period is a step whose noise contains the aid's, turned by the fast steps: M_p = F_fast M.
    """
    period = chain.period()
    M = repeated(chain.fast, chain.ratio).F @ chain.M
    return steady_covariance(period.F, period.Q, chain.H, chain.R, M)
