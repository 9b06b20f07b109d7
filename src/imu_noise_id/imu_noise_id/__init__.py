"""Noise models of IMU, magnetometer and GNSS channels: identify, simulate, reconcile, export.

This page states once what every module of the package assumes.

Data flow
---------
``recording`` (samples and their quality) -> ``series`` (one channel on a uniform grid) ->
``allan``, ``spectrum``, ``cca`` (curves with intervals) -> ``effects`` (what a noise is made of)
-> ``identify`` -> ``model`` (a list of effects per channel) -> ``simulate``, ``reconcile``,
``export``, ``report``.  ``bags`` and ``ros`` are the only modules that know files and messages;
nothing but ``ros`` imports rclpy.

Units
-----
SI throughout: rad/s, m/s^2, T, m, m/s, rad, K differences, s, Hz.  The degree Celsius appears only
as the unit of a recorded temperature.  Every noise density is continuous, per sqrt(Hz), and
*two-sided*: ``density`` of white noise is Allan's N, the per-sample standard deviation times the
root of the sample time.  A data sheet's one-sided density is sqrt(2) larger.  A name carries its
unit where a unit is not the channel's own: ``stamp_ns``, ``sample_time_s``, ``frequency_hz``.

Spectra
-------
``psd`` is two-sided, in unit^2/Hz, of the *sampled* signal (aliasing included), at frequencies
from 0 to half the sample rate.  The variance is its integral from minus to plus half the rate.

Time
----
Stamps are ``int64`` nanoseconds of the header (``stamp_ns``).  Times in a model or a report
(``time_s``, ``from_s``, ``to_s``) are seconds since the recording's first stamp.

Frames
------
IMU and magnetometer channels are in the sensor's own axes (REP 145).  Positions and velocities are
east, north, up about the recording's mean (REP 103, REP 105).

Channel names
-------------
``angular_velocity.{x,y,z}`` rad/s, ``linear_acceleration.{x,y,z}`` m/s^2,
``position.{east,north,up}`` m, ``velocity.{east,north,up}`` m/s, ``magnetic_field.{x,y,z}`` T,
``heading`` rad; the regressor ``temperature`` degC.

Arrays
------
``float64`` unless said otherwise, shape in the docstring, never modified in place.  A missing
sample is marked by a boolean mask, never by a NaN.
"""

__version__ = "0.1.0"
