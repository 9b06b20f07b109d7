"""``fuse`` as it runs on a robot, over real DDS."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from imu_noise_id.bag_writer import TopicBytes, write_bag
from imu_noise_id.model_file import load_model
from nav_fusion.fuse import fuse_bag
from nav_fusion.published import FIX_TOPIC, ODOMETRY_TOPIC, fix_messages, odometry_messages
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu, NavSatFix

from helpers.live import Listener, Program
from imu_noise_id import cdr
from noise_msgs.msg import FilterStatus

Start = Callable[..., Program]
RATE_HZ = 100
START_NS = 1_700_000_000_000_000_000
DEEP = QoSProfile(depth=5000)
MODEL = """\
format: model/1
channels:
""" + "".join(
    f"- name: {name}.{axis}\n"
    f"  effects:\n"
    f"  - {{name: white_noise, parameters: {{density: {density}}}}}\n"
    f"  - {{name: gauss_markov, parameters: {{sigma: {sigma}, correlation_time_s: 200.0}}}}\n"
    for name, density, sigma in (
        ("angular_velocity", 2e-4, 1e-4),
        ("linear_acceleration", 2e-3, 1e-3),
    )
    for axis in "xyz"
)


def write_drive(path: Path, rng: np.random.Generator) -> Path:
    """40 s: rest, then to and fro in the east.

    Fixes come up to 0.4 s late, none from 20 to 26 s nor in the last 2 s: what arrives together
    with the last sample may arrive on either side of it.
    """
    n = 40 * RATE_HZ
    t = np.arange(n) / RATE_HZ
    imu_ns = START_NS + np.arange(n) * (1_000_000_000 // RATE_HZ)
    push = np.where(t > 5.0, 1.5 * np.sin(0.8 * (t - 5.0)), 0.0)
    imu = {f"angular_velocity.{a}": rng.normal(0.0, 2e-3, n) for a in "xyz"}
    imu |= {f"linear_acceleration.{a}": rng.normal(0.0, 2e-2, n) for a in "xyz"}
    imu["linear_acceleration.x"] = imu["linear_acceleration.x"] + push
    imu["linear_acceleration.z"] = imu["linear_acceleration.z"] + 9.81
    since = np.maximum(t - 5.0, 0.0)
    east = np.interp(np.arange(0, 40, 0.2), t, 1.5 / 0.8 * (since - np.sin(0.8 * since) / 0.8))
    m = east.size
    fix_s = np.arange(m) * 0.2
    kept = (fix_s < 20.0) | ((fix_s > 26.0) & (fix_s < 38.0))
    fix_ns = START_NS + np.rint(fix_s * 1e9).astype(np.int64) + 3_000_000
    late_ns = np.rint(rng.choice([20e6, 150e6, 400e6], m)).astype(np.int64)
    fix = {
        "latitude": np.full(m, 48.0) + rng.normal(0.0, 1e-6, m),
        "longitude": 11.0 + east / (111_320.0 * np.cos(np.radians(48.0))),
        "altitude": 500.0 + rng.normal(0.0, 0.2, m),
        "covariance_type": np.full(m, 2.0),
        "status": np.where(rng.random(m) < 0.05, -1.0, 0.0),
    } | {f"position_covariance.{k}": np.full(m, v) for k, v in ((0, 0.3), (4, 0.3), (8, 1.0))}
    fix = {name: column[kept] for name, column in fix.items()}
    fix_ns, late_ns = fix_ns[kept], late_ns[kept]
    order = np.argsort(fix_ns + late_ns, kind="stable")
    fix = {name: column[order] for name, column in fix.items()}
    write_bag(
        path,
        [
            TopicBytes("/imu/data", cdr.IMU, imu_ns, cdr.encode(cdr.IMU, imu_ns, imu, "imu")),
            TopicBytes(
                "/gps/fix",
                cdr.NAV_SAT_FIX,
                (fix_ns + late_ns)[order],
                cdr.encode(cdr.NAV_SAT_FIX, fix_ns[order], fix, "gps"),
            ),
        ],
    )
    return path


def model_file(folder: Path) -> Path:
    path = folder / "model.yaml"
    path.write_text(MODEL)
    return path


def stamp_ns(message: Odometry | NavSatFix) -> int:
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def fuse(start: Start, *settings: str) -> Program:
    return start("nav_fusion", "fuse", "--ros-args", *settings)


def test_late_and_lost_fixes_end_in_the_state_of_the_bag_to_the_last_digit(
    start: Start, listener: Listener, tmp_path: Path
) -> None:
    bag = write_drive(tmp_path / "bag", np.random.default_rng(2))
    model = model_file(tmp_path)
    node = fuse(start, "-p", f"model_file:={model}")
    poses = listener.hear(Odometry, ODOMETRY_TOPIC, DEEP)
    places = listener.hear(NavSatFix, FIX_TOPIC, DEEP)
    states = listener.hear(FilterStatus, "/fuse/status", DEEP)
    listener.until(lambda: listener.node.count_subscribers("/gps/fix"), "the node")
    play = start("nav_fusion", "play", "--bag", str(bag), "--rate", "4", "--wait", "20")
    offline = fuse_bag(bag, load_model(model))
    expected = odometry_messages(offline.solution)
    last_ns = int(offline.solution.stamp_ns[-1])

    listener.until(lambda: poses and stamp_ns(poses[-1]) >= last_ns, "the last state")
    listener.until(lambda: places and stamp_ns(places[-1]) >= last_ns, "the last place")
    assert play.wait() == 0, play.output
    assert poses[-1] == deserialize_message(expected[-1].tobytes(), Odometry)
    last_place = fix_messages(offline.solution)[-1]
    assert places[-1] == deserialize_message(last_place.tobytes(), NavSatFix)

    live = {stamp_ns(p): p for p in poses}
    pairs = [
        live[ns] == deserialize_message(row.tobytes(), Odometry)
        for ns, row in zip(offline.solution.stamp_ns.tolist(), expected, strict=True)
        if ns in live
    ]
    assert len(pairs) > 0.98 * len(expected)
    assert np.mean(pairs) > 0.5  # the rest: a fix and a sample that came in the other order
    found = offline.status
    listener.until(lambda: states[-1].imu_samples == found.imu_samples, "the last status")
    state = states[-1]
    assert (state.fixes_used, state.fixes_gated) == (found.used, found.gated)
    assert state.fixes_rejected == found.rejected
    assert state.fixes_late > 0
    assert node.end(signal.SIGINT) == 0
    assert "Traceback" not in node.output


def test_it_publishes_without_fixes_and_begins_anew_when_time_does(
    start: Start, listener: Listener, tmp_path: Path
) -> None:
    bag = write_drive(tmp_path / "bag", np.random.default_rng(3))
    node = fuse(start, "-p", f"model_file:={model_file(tmp_path)}")
    poses = listener.hear(Odometry, ODOMETRY_TOPIC, DEEP)
    told = listener.hear(DiagnosticArray, "/diagnostics", 50)
    listener.until(lambda: listener.node.count_subscribers("/gps/fix"), "the node")
    play = start("nav_fusion", "play", "--bag", str(bag), "--rate", "4", "--loop")
    listener.until(lambda: poses, "odometry")
    # nothing but samples between these two: the fixes are lost
    listener.until(lambda: stamp_ns(poses[-1]) > START_NS + 25 * 10**9, "odometry without fixes")
    lost = [p for p in poses if START_NS + 21 * 10**9 < stamp_ns(p) < START_NS + 25 * 10**9]
    assert len(lost) > 150
    for message in lost:
        assert np.linalg.eigvalsh(np.array(message.pose.covariance).reshape(6, 6))[0] > 0
    assert (lost[0].header.frame_id, lost[0].child_frame_id) == ("map", "base_link")

    def restarted() -> bool:
        return any("started anew" in s.message for a in told for s in a.status)

    listener.until(restarted, "the restart in diagnostics")
    assert play.end() == 0, play.output
    samples = listener.node.create_publisher(Imu, "/imu/data", DEEP)
    listener.until(samples.get_subscription_count, "the node")
    broken = Imu()
    broken.linear_acceleration.x = float("nan")
    samples.publish(broken)
    listener.until(
        lambda: any("not finite" in s.message for s in told[-1].status), "the sample that is none"
    )
    assert node.end() == 0
    assert "terminate called" not in node.output


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("publish_rate_hz:=1000000.0", "publish_rate_hz"),
        ("lever_arm_m:=[1.0]", "lever_arm_m"),
        ("model_file:=/nowhere/model.yaml", "/nowhere/model.yaml"),
        ("lateness_s:=late", "lateness_s"),
    ],
)
def test_a_bad_parameter_is_one_line_and_status_2(start: Start, setting: str, named: str) -> None:
    node = fuse(start, "-p", setting)
    assert node.wait() == 2
    (line,) = node.output.strip().splitlines()
    assert named in line
