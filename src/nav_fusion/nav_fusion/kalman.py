"""The Kalman filter's algebra, written once: predict, correct, and both with correlated noises.

Model::

    x_{k+1} = F x_k + w_k,   y_k = H x_k + v_k,   E[w w'] = Q,   E[v v'] = R

Pure functions on a mean and a covariance.  Where w and v are correlated there are two timings; both
are exact (thesis, chapter 6, corrected: see ``docs``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Gaussian:
    """Mean (n,) and covariance (n, n)."""

    mean: Floats
    covariance: Floats


@dataclass(frozen=True)
class Correction:
    """What a measurement did.

    Attributes
    ----------
    state : Gaussian
        After the correction.
    innovation : (k,) float64
        y - H x.
    innovation_covariance : (k, k) float64
    gain : (n, k) float64
    """

    state: Gaussian
    innovation: Floats
    innovation_covariance: Floats
    gain: Floats

    @property
    def nis(self) -> float:
        """y' S^-1 y of the innovation."""
        return float(self.innovation @ np.linalg.solve(self.innovation_covariance, self.innovation))


def predict(state: Gaussian, F: Floats, Q: Floats) -> Gaussian:
    """x <- F x, P <- F P F' + Q."""
    return Gaussian(F @ state.mean, _symmetric(F @ state.covariance @ F.T + Q))


def correct(state: Gaussian, y: Floats, H: Floats, R: Floats) -> Correction:
    """Correct by a measurement whose noise is independent of everything (Joseph's form)."""
    x, P = state.mean, state.covariance
    S = _symmetric(H @ P @ H.T + R)
    K = _gain(P @ H.T, S)
    keep = np.eye(x.size) - K @ H
    innovation = y - H @ x
    corrected = Gaussian(x + K @ innovation, _symmetric(keep @ P @ keep.T + K @ R @ K.T))
    return Correction(corrected, innovation, S, K)


def correct_after_noise(state: Gaussian, y: Floats, H: Floats, R: Floats, M: Floats) -> Correction:
    """Correct where the measurement shares noise with the step that led to it.

    M = E[w_{k-1} v_k'] (n, k), the thesis's timing: S = H P H' + H M + M' H' + R,
    K = (P H' + M) S^-1, P <- P - K S K', here as Joseph's form with its cross terms.
    """
    x, P = state.mean, state.covariance
    S = _symmetric(H @ P @ H.T + H @ M + M.T @ H.T + R)
    K = _gain(P @ H.T + M, S)
    keep = np.eye(x.size) - K @ H
    cross = keep @ M @ K.T
    innovation = y - H @ x
    covariance = keep @ P @ keep.T - cross - cross.T + K @ R @ K.T
    return Correction(Gaussian(x + K @ innovation, _symmetric(covariance)), innovation, S, K)


def correct_and_predict(
    state: Gaussian, y: Floats, H: Floats, R: Floats, F: Floats, Q: Floats, M: Floats
) -> Correction:
    """Correct and predict at once where the measurement shows the noise of the step that follows.

    M = E[w_k v_k'] (n, k), same sample: K = (F P H' + M) S^-1, x <- F x + K (y - H x),
    P <- F P F' + Q - K S K' (Anderson and Moore 1979, section 5.4).
    """
    x, P = state.mean, state.covariance
    S = _symmetric(H @ P @ H.T + R)
    K = _gain(F @ P @ H.T + M, S)
    keep = F - K @ H
    cross = M @ K.T
    innovation = y - H @ x
    covariance = keep @ P @ keep.T + Q + K @ R @ K.T - cross - cross.T
    return Correction(Gaussian(F @ x + K @ innovation, _symmetric(covariance)), innovation, S, K)


def steady_covariance(
    F: Floats, Q: Floats, H: Floats, R: Floats, M: Floats | None = None
) -> Floats:
    """Covariance before the correction to which the filter settles: discrete Riccati equation.

    P = F P F' + Q - (F P H' + M)(H P H' + R)^-1 (F P H' + M)', by the structured doubling of the
    equation without cross term (F - M R^-1 H, Q - M R^-1 M'; Chu, Fan, Lin 2004).

    Raises
    ------
    numpy.linalg.LinAlgError
        When it does not converge: a state that is neither seen nor stable.
    """
    R_inverse = np.linalg.inv(R)
    if M is not None:
        F = F - M @ R_inverse @ H
        Q = Q - M @ R_inverse @ M.T
    identity = np.eye(F.shape[0])
    A, G, P = F.T.copy(), H.T @ R_inverse @ H, Q.copy()
    for _ in range(100):
        W = np.linalg.inv(identity + G @ P)
        A_W = A @ W
        new_G = G + A_W @ G @ A.T
        new_P = P + A.T @ P @ W @ A
        done = np.max(np.abs(new_P - P)) <= 1e-14 * np.max(np.abs(new_P))
        A, G, P = A_W @ A, _symmetric(new_G), _symmetric(new_P)
        if done:
            return P
        if np.max(np.abs(P)) > 1e60:
            break
    raise np.linalg.LinAlgError("the filter has no steady state")


def _gain(cross: Floats, S: Floats) -> Floats:
    return np.asarray(cho_solve(cho_factor(S), cross.T)).T


def _symmetric(P: Floats) -> Floats:
    return 0.5 * (P + P.T)
