"""The formulae of how sensors sense agree with mechanics worked out another way."""

import numpy as np
import pytest
from imu_noise_id.physics import (
    STANDARD_GRAVITY,
    attitude,
    beam_acceleration,
    beam_frequency_hz,
    damping_ratio,
    euler_rates,
    gravity_projection,
    mass_spring,
    natural_frequency_hz,
    sagnac_delay_s,
    sagnac_path_m,
    specific_force,
)
from imu_noise_id.transfer_function import bandwidth_3db_hz, step_response
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation


def test_mass_and_spring_moves_as_newton_says():
    mass, damping, stiffness = 2e-3, 0.05, 3.0
    transfer = mass_spring(mass, damping, stiffness)

    def motion(_, state):
        return [state[1], (mass - damping * state[1] - stiffness * state[0]) / mass]

    time_s = np.linspace(0.0, 0.5, 50)
    solved = solve_ivp(motion, (0.0, 0.5), [0.0, 0.0], t_eval=time_s, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(step_response(transfer, time_s), solved.y[0], atol=1e-9)
    ratio, frequency_hz = (
        damping_ratio(mass, damping, stiffness),
        natural_frequency_hz(mass, stiffness),
    )
    rolls_off = frequency_hz * np.sqrt(1 - 2 * ratio**2 + np.sqrt(2 - 4 * ratio**2 + 4 * ratio**4))
    assert bandwidth_3db_hz(transfer) == pytest.approx(rolls_off)


def test_a_beam_read_backwards_gives_the_acceleration():
    acceleration = np.array([-9.0, 0.0, 30.0])
    frequency_hz = beam_frequency_hz(acceleration, 1e-3, 4e5, 1e5)
    np.testing.assert_allclose(
        beam_acceleration(frequency_hz, 1e-3, 4e5, 1e5), acceleration, atol=1e-8
    )
    assert frequency_hz[1] == pytest.approx(natural_frequency_hz(1e-3, 4e5))
    assert np.all(np.diff(frequency_hz) > 0)
    with pytest.raises(ValueError, match="buckles"):
        beam_frequency_hz(-1e9, 1e-3, 4e5, 1e5)


def test_sagnac_delay_is_the_path_over_the_speed_of_light_and_has_the_known_size():
    radius_m = 0.1
    path_m = sagnac_path_m(1.0, np.pi * radius_m**2)
    assert sagnac_delay_s(1.0, radius_m) == pytest.approx(path_m / 299_792_458.0)
    assert sagnac_delay_s(7.292e-5, radius_m) == pytest.approx(1.02e-22, rel=0.01)


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.3, -0.7, 2.0), (-2.0, 1.1, -0.4)])
def test_gravity_and_attitude_agree_with_an_independent_rotation(angles):
    roll, pitch, yaw = angles
    to_body = Rotation.from_euler("ZYX", [yaw, pitch, roll]).inv()
    np.testing.assert_allclose(attitude(*angles), to_body.as_matrix(), atol=1e-12)
    expected = to_body.apply([0.0, 0.0, -STANDARD_GRAVITY])
    np.testing.assert_allclose(gravity_projection(roll, pitch), expected, atol=1e-12)


def test_euler_rates_integrate_to_the_rotation_that_the_gyros_saw():
    rate = np.array([0.4, -0.3, 0.5])
    solved = solve_ivp(
        lambda _, a: euler_rates(a[0], a[1], rate),
        (0.0, 1.5),
        [0.1, 0.2, 0.3],
        rtol=1e-10,
        atol=1e-12,
    )
    start = Rotation.from_euler("ZYX", [0.3, 0.2, 0.1])
    expected = (start * Rotation.from_rotvec(1.5 * rate)).as_euler("ZYX")[::-1]
    np.testing.assert_allclose(solved.y[:, -1], expected, atol=1e-8)


def test_euler_rates_refuse_the_singular_pitch():
    with pytest.raises(ValueError, match="singular"):
        euler_rates(0.0, np.pi / 2, np.zeros(3))


def test_specific_force_is_acceleration_less_gravity_in_the_body():
    """A body on a turning, accelerating course: differentiate its level velocity instead."""
    rate, velocity, velocity_rate = (
        np.array([0.2, -0.1, 0.4]),
        np.array([12.0, -1.0, 3.0]),
        np.array([0.5, 2.0, -1.0]),
    )
    roll, pitch, step = 0.3, -0.4, 1e-5
    to_level = Rotation.from_euler("ZYX", [0.7, pitch, roll])

    def level_velocity(t):
        return (to_level * Rotation.from_rotvec(rate * t)).apply(velocity + velocity_rate * t)

    acceleration = (level_velocity(step) - level_velocity(-step)) / (2 * step)
    expected = to_level.inv().apply(acceleration - np.array([0.0, 0.0, STANDARD_GRAVITY]))
    found = specific_force(velocity_rate, rate, velocity, roll, pitch)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    third = velocity_rate[2] + rate[0] * velocity[1] - rate[1] * velocity[0]
    assert found[2] == pytest.approx(third + gravity_projection(roll, pitch)[2])


def test_a_mass_must_be_positive():
    with pytest.raises(ValueError, match="mass_kg must be positive"):
        mass_spring(0.0, 1.0, 1.0)
