"""``identify`` as it runs on a robot, over real DDS."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from imu_noise_id.bags import read_recording
from imu_noise_id.checkpoint import load_checkpoint
from imu_noise_id.identify import identify_recording
from imu_noise_id.live import findings
from imu_noise_id.ros.messages import allan_messages, model_message, to_time
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu

from helpers.live import Listener, Program, write_still_bag
from noise_msgs.msg import AllanCurve, DiscrepancyReport, NoiseModel
from noise_msgs.srv import Identify, Reset

Start = Callable[..., Program]
ONLY_ASKED = ("-p", "first_after_s:=3600.0")
RATE_HZ = 100


def identify(start: Start, *settings: str) -> Program:
    return start("imu_noise_id", "identify", "--ros-args", *settings)


def imu_sender(listener: Listener, reliable: bool = True) -> Callable[..., None]:
    """Return a function that publishes n samples of 100 Hz from a stamp on."""
    kind = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    publisher = listener.node.create_publisher(
        Imu, "/imu/data", QoSProfile(depth=10_000, reliability=kind)
    )
    rng = np.random.default_rng(3)
    listener.until(publisher.get_subscription_count, "a subscriber of /imu/data")

    def send(start_ns: int, n: int, bad: float | None = None, step_ns: int = 10_000_000) -> None:
        for k in range(n):
            message = Imu()
            message.header.stamp = to_time(start_ns + k * step_ns)
            message.angular_velocity.x, message.angular_velocity.y = rng.normal(0.0, 1e-3, 2)
            message.linear_acceleration.z = 9.81 + rng.normal(0.0, 1e-2)
            if bad is not None:
                message.angular_velocity.z = bad
            publisher.publish(message)

    return send


def said(heard: list[DiagnosticArray], topic: str = "/imu/data") -> str:
    """Everything that diagnostics have said of a topic."""
    return "\n".join(
        s.message for array in heard for s in array.status if s.name == f"identify: {topic}"
    )


def number(heard: list[DiagnosticArray], key: str, topic: str = "/imu/data") -> float:
    """The newest number of that name, -1 where there is none yet."""
    for array in reversed(heard):
        for status in array.status:
            if status.name == f"identify: {topic}":
                return float(next(v.value for v in status.values if v.key == key))
    return -1.0


def test_the_live_model_equals_the_offline_one_to_the_last_digit(
    start: Start, listener: Listener, tmp_path: Path
) -> None:
    bag = write_still_bag(tmp_path / "bag", 40.0, RATE_HZ, np.random.default_rng(1))
    identify(start, *ONLY_ASKED)
    models = listener.hear(NoiseModel, "/identify/model")
    curves = listener.hear(AllanCurve, "/identify/allan")
    listener.until(lambda: listener.node.count_subscribers("/gps/fix"), "the node")
    play = start("nav_fusion", "play", "--bag", str(bag), "--rate", "20", "--wait", "20")
    assert play.wait() == 0, play.output

    answer = listener.call(Identify, "/identify/identify", Identify.Request())
    offline = findings(identify_recording(read_recording(bag)), "imu_link")
    expected, expected_curves = model_message(offline), allan_messages(offline)
    listener.until(lambda: models and len(curves) == len(expected_curves), "model and curves")

    expected.source = "live"
    assert answer.success, answer.message
    assert [c.name for c in answer.model.channels] == [c.name for c in expected.channels]
    assert answer.model == expected
    assert models[-1] == expected
    assert curves == expected_curves


def test_what_is_latched_reaches_who_comes_late(start: Start, listener: Listener) -> None:
    identify(start, "-p", "first_after_s:=5.0", "-p", "publish_period_s:=0.5")
    imu_sender(listener)(10**18, 1000)
    first = listener.hear(NoiseModel, "/identify/model")
    listener.until(lambda: first, "a model without being asked")
    late = listener.hear(AllanCurve, "/identify/allan")
    listener.until(lambda: {c.channel for c in late} >= {"angular_velocity.x"}, "the curves")


@pytest.mark.parametrize("number_", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_cleanly_while_it_works(
    start: Start, listener: Listener, number_: int
) -> None:
    node = identify(start, "-p", "first_after_s:=5.0", "-p", "publish_period_s:=0.5")
    models = listener.hear(NoiseModel, "/identify/model")
    send = imu_sender(listener)
    send(10**18, 1000)
    listener.until(lambda: models, "a model")
    send(10**18 + 10**10, 1000)
    assert node.end(number_) == 0, node.output
    assert "terminate called" not in node.output
    assert "Traceback" not in node.output


def test_it_goes_on_through_all_that_streams_do(start: Start, listener: Listener) -> None:
    node = identify(start, *ONLY_ASKED)
    heard = listener.hear(DiagnosticArray, "/diagnostics", 50)
    send = imu_sender(listener)
    start_ns = 2 * 10**18

    send(start_ns, 500)
    listener.until(lambda: number(heard, "received") == 500, "500 samples")
    send(start_ns + 6 * 10**9, 100)  # a gap of a second
    send(start_ns + 7 * 10**9, 10, bad=float("nan"))
    send(start_ns + 7 * 10**9 + 10**8, 20, bad=float("inf"))
    listener.until(lambda: number(heard, "non_finite") == 30, "30 samples that are not finite")
    assert number(heard, "gaps") == 1
    assert number(heard, "missing") == 100
    send(start_ns + 60 * 10**9, 100)  # a minute ahead
    send(start_ns + 10 * 10**9, 100)  # and back
    send(start_ns + 11 * 10**9, 50, step_ns=0)  # frozen
    listener.until(lambda: number(heard, "duplicates") == 49, "repeated stamps")
    listener.until(lambda: "the clock jumped by -5" in said(heard), "the clock's step")

    answer = listener.call(Identify, "/identify/identify", Identify.Request())
    assert answer.success, answer.message
    assert node.process.poll() is None
    values = [p.value for c in answer.model.channels for e in c.effects for p in e.parameters]
    assert np.isfinite(values).all()


def test_it_hears_best_effort_publishers_too_and_says_so(start: Start, listener: Listener) -> None:
    identify(start, *ONLY_ASKED)
    heard = listener.hear(DiagnosticArray, "/diagnostics", 50)
    send = imu_sender(listener, reliable=False)
    listener.until(lambda: "best effort" in said(heard), "the complaint")
    send(10**18, 20)
    listener.until(lambda: number(heard, "received") > 0, "best-effort samples")


def test_publishers_that_come_go_double_or_send_something_else_are_named(
    start: Start, listener: Listener
) -> None:
    identify(start, *ONLY_ASKED)
    heard = listener.hear(DiagnosticArray, "/diagnostics", 50)
    listener.until(lambda: "no message yet" in said(heard), "the first diagnostics")
    wrong = listener.node.create_publisher(TwistStamped, "/imu/data", 10)
    listener.until(lambda: "geometry_msgs/msg/TwistStamped" in said(heard), "the wrong type")
    listener.node.destroy_publisher(wrong)
    listener.node.create_publisher(TwistStamped, "/imu/mag", 10)
    listener.until(
        lambda: "geometry_msgs/msg/TwistStamped" in said(heard, "/imu/mag"), "the wrong field"
    )
    first = imu_sender(listener)
    for k in range(10):
        sender = listener.node.create_publisher(Imu, "/imu/data", 10)
        listener.until(sender.get_subscription_count, f"restart {k}")
        listener.node.destroy_publisher(sender)
    imu_sender(listener)
    listener.until(lambda: "2 publishers: /listener, /listener" in said(heard), "the second one")
    first(10**18, 100)
    listener.until(lambda: number(heard, "received") == 100, "the samples after all that")


def test_reset_forgets_and_names_what_it_does_not_know(start: Start, listener: Listener) -> None:
    identify(start, *ONLY_ASKED)
    heard = listener.hear(DiagnosticArray, "/diagnostics", 50)
    imu_sender(listener)(10**18, 300)
    listener.until(lambda: number(heard, "received") == 300, "300 samples")
    refused = listener.call(Reset, "/identify/reset", Reset.Request(topics=["/nothing"]))
    assert not refused.success
    assert "/nothing" in refused.message
    answer = listener.call(Reset, "/identify/reset", Reset.Request())
    assert answer.success
    assert answer.message.startswith("300 samples")
    nothing = listener.call(Identify, "/identify/identify", Identify.Request())
    assert not nothing.success
    assert "/imu/data" in nothing.message


def test_after_kill_9_it_resumes_from_its_checkpoint(
    start: Start, listener: Listener, tmp_path: Path
) -> None:
    file = tmp_path / "kept" / "identify.checkpoint"
    keep = ("-p", f"checkpoint:={file}", "-p", "checkpoint_period_s:=1.0")
    first = identify(start, *ONLY_ASKED, *keep)
    send = imu_sender(listener)
    send(10**18, 1000)
    heard = listener.hear(DiagnosticArray, "/diagnostics", 50)
    listener.until(lambda: number(heard, "received") == 1000 and file.exists(), "a checkpoint")
    written = file.stat().st_mtime_ns
    listener.until(lambda: file.stat().st_mtime_ns > written, "a checkpoint with all of it")
    first.kill()

    second = identify(start, *ONLY_ASKED, *keep)
    answer = listener.call(Identify, "/identify/identify", Identify.Request())
    assert answer.success, answer.message
    assert {c.samples for c in answer.model.channels} == {1000}
    assert second.end() == 0


def test_a_checkpoint_that_is_none_is_one_line_and_status_2(start: Start, tmp_path: Path) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("not a checkpoint")
    node = identify(start, "-p", f"checkpoint:={file}")
    assert node.wait() == 2
    (line,) = node.output.strip().splitlines()
    assert str(file) in line


def test_a_reference_model_that_is_not_the_sensors_is_contradicted(
    start: Start, listener: Listener, tmp_path: Path
) -> None:
    file = tmp_path / "model.yaml"
    file.write_text(
        "format: model/1\nchannels:\n"
        + "".join(
            f"- name: angular_velocity.{axis}\n  rate_hz: 100.0\n  effects:\n"
            f"  - {{name: white_noise, parameters: {{density: {density}}}}}\n"
            for axis, density in (("x", 1e-4), ("y", 1e-3))
        )
    )
    identify(start, *ONLY_ASKED, "-p", f"reference_model:={file}")
    heard = listener.hear(DiagnosticArray, "/diagnostics", 50)
    reports = listener.hear(DiscrepancyReport, "/identify/discrepancy")
    imu_sender(listener)(10**18, 3000)
    listener.until(lambda: number(heard, "received") == 3000, "3000 samples")
    assert listener.call(Identify, "/identify/identify", Identify.Request()).success
    (report,) = listener.until(lambda: reports, "the report")
    verdicts = {channel.name: channel.verdict for channel in report.channels}
    assert verdicts["angular_velocity.x"] == "agrees"
    assert verdicts["angular_velocity.y"] == "unexplained"


def test_a_checkpoint_that_cannot_be_written_is_said_and_written_once_it_can(
    start: Start, listener: Listener, tmp_path: Path
) -> None:
    folder = tmp_path / "disk"
    folder.write_text("in the way")
    file = folder / "identify.checkpoint"
    keep = ("-p", f"checkpoint:={file}", "-p", "checkpoint_period_s:=1.0")
    identify(start, *ONLY_ASKED, *keep)
    heard = listener.hear(DiagnosticArray, "/diagnostics", 50)
    imu_sender(listener)(10**18, 1000)

    def told() -> str:
        return "".join(s.message for a in heard for s in a.status if s.name == "identify: model")

    listener.until(lambda: f"{file}: cannot be written" in told(), "the complaint")
    folder.unlink()
    listener.until(file.exists, "the checkpoint")
    (columns, *_) = load_checkpoint(file).columns
    assert columns.stamp_ns.size == 1000
