"""Multirate Kalman filter for an IMU and a GNSS receiver, its error budget and its replay.

This page states once what every module of the package assumes.

Data flow
---------
``imu_noise_id.model`` (a list of effects per channel) -> ``noise`` (white densities and slow terms
of every axis) -> ``state`` (which states the filter has) -> ``engine`` (the filter: fed in order
of arrival by ``fuse`` from a bag or by ``ros`` live) -> ``solution`` (what is published) ->
``consistency``, ``budget``.  ``kalman``, ``discretize``, ``schedule`` and ``chains`` are the
one-axis filters of chapter 6 on the same algebra.  Nothing but ``ros`` imports rclpy.

Frames
------
``e``  Earth-centred, Earth-fixed, WGS-84; the filter works in it.
``n``  east, north, up at a point (REP 103); positions in metres about the *origin*, the first fix
       used unless a parameter says otherwise.
``b``  body (``base_link``): forward, left, up; the IMU's axes turned by ``mounting``.
``C_eb`` or ``C`` takes vectors of b to e; ``q`` is the same rotation as a quaternion (w, x, y, z).
Heading is yaw of REP 103: zero east, counter-clockwise.  A magnetometer's declination is positive
when magnetic north lies east of true north.

States
------
An error is *true minus estimate*, C_true = (I + [psi x]) C: position r (m), velocity v (m/s),
attitude psi (rad), all in e, then one *slow state* per slow term of the noise model, each a
first-order process b' = -b/T + w with T infinite for a walk or a constant.  A sensor reads true
value + slow terms + white noise.

Time
----
``stamp_ns`` (int64) is the header's.  An IMU sample is the value *at* its stamp; between two
samples the filter integrates their straight line.  A fix holds at its stamp less ``gnss_delay_s``.

Noise
-----
Densities are continuous and per second, never per step: SI, per sqrt(Hz), two-sided, as in
``imu_noise_id``.

Letters
-------
x, P, F, Q, H, R, S, K, C as in every textbook and only inside the mathematics; F is always the
*transition* over a step and A the derivative.
"""

__version__ = "0.1.0"
