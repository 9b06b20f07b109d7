"""The engine's figures as noise_msgs/FilterStatus."""

from __future__ import annotations

from imu_noise_id.ros.messages import finite
from scipy.special import chdtrc

from nav_fusion import observe
from nav_fusion.engine import Engine
from noise_msgs.msg import FilterStatus

_FIX_DOF = 3


def filter_status(engine: Engine) -> FilterStatus:
    """Return the figures; the caller knows frame, stamp, latency and what the stream lacks."""
    found = engine.status()
    message = FilterStatus(
        model_source=engine.noise.source,
        initialised=engine.running and found.aligned,
        nis=finite(found.nis_last),
        nis_dof=_FIX_DOF if found.nis_last is not None else 0,
        gate=finite(found.gate),
        gated=found.nis_last is not None and found.nis_last > found.gate,
        nis_mean=finite(found.nis_mean),
        nis_lower=finite(found.nis_lower),
        nis_upper=finite(found.nis_upper),
        nis_count=found.nis_dof // _FIX_DOF,
        white=bool(found.white),
        innovation_correlation=finite(found.correlation),
        gyro_bias=_three(found.gyro_bias),
        gyro_bias_sigma=_three(found.gyro_bias_sigma),
        accel_bias=_three(found.accel_bias),
        accel_bias_sigma=_three(found.accel_bias_sigma),
        imu_samples=found.imu_samples,
        dropped=found.imu_duplicates + found.imu_out_of_order + found.imu_non_finite,
        fixes_used=found.used,
        fixes_gated=found.gated,
        fixes_late=found.late,
        fixes_rejected=found.rejected,
        notes=list(found.notes),
    )
    if found.whiteness is not None:
        message.whiteness_p_value = finite(float(chdtrc(observe.LAGS, found.whiteness)))
    return message


def _three(values: tuple[float, ...]) -> list[float]:
    return [finite(value) for value in values] or [0.0, 0.0, 0.0]
