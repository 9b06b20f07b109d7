"""Whether a narrow band rings all the time or after shocks now and then.

Noise that drives a resonance leaves an envelope of Rayleigh's law; the rings of single shocks have
the same spectrum, and an envelope that is high for a while and then is not there.  With e the power
of the band over its mean, the mean of e^2 is 2 for the one and more for the other.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.reconcile.null import Null
from imu_noise_id.reconcile.state import Analysis
from imu_noise_id.recording import Floats

WIDTHS = 5.0
"""Bandwidths to either side that are looked at: a Lorentzian has a hundredth of its peak there."""
FEWEST_ORDINATES = 32
SIMULATIONS = 400
NAME = "intermittent"


def intermittence(found: Analysis, band: NarrowBand) -> float:
    """Logarithm of the chance that a steady band of this spectrum has so uneven an envelope.

    The whitened record is filtered by the root of the band's share of the spectrum: matched to a
    single ring, so that those below the noise show too.  The null is simulated on the same
    ordinates.  0 where there are too few of them.
    """
    n, dt = found.coefficients.size, found.state.sample_time_s
    reach_hz = WIDTHS * band.bandwidth_hz
    low = max(int((band.frequency_hz - reach_hz) * n * dt), 1)
    high = min(int((band.frequency_hz + reach_hz) * n * dt) + 1, n // 2)
    if high - low < FEWEST_ORDINATES:
        return 0.0
    share = (
        band.psd(np.arange(low, high) / (n * dt), dt) * found.inverse_psd[2 * low : 2 * high : 2]
    )
    root = np.sqrt(np.clip(share, 0.0, 1.0))
    seen = _unevenness(fft.rfft(found.white.samples)[low:high] * root)
    rng = np.random.default_rng([low, high])
    drawn = np.sort([_unevenness(_noise(root, rng)) for _ in range(SIMULATIONS)])
    return Null((NAME,), drawn[:, None]).log_p(NAME, seen)


def _noise(root: Floats, rng: np.random.Generator) -> np.ndarray:
    return root * (rng.standard_normal(root.size) + 1j * rng.standard_normal(root.size))


def _unevenness(baseband: np.ndarray) -> float:
    power = np.abs(fft.ifft(baseband, fft.next_fast_len(baseband.size))) ** 2
    return float(np.mean((power / max(float(power.mean()), 1e-300)) ** 2))
