"""Play a recording live, identify it, find what is hidden in another, fuse, and tell the story.

Every step is a command that a reader could type; it is printed before it runs.  What the steps say
is gathered on one page, ``report.html``, that leads to each step's own.
"""

from __future__ import annotations

import html
import json
import re
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
import yaml
from imu_noise_id.allan import AllanCurve
from imu_noise_id.bags import read_recording
from imu_noise_id.curves import model_psd
from imu_noise_id.model_file import load_model
from imu_noise_id.report import figures
from imu_noise_id.report.curves import Part, allan_parts
from imu_noise_id.report.page import Figure, Page, Section, Snippet, Table, render
from imu_noise_id.report.plot import Axis, Plot
from imu_noise_id.series import to_series
from imu_noise_id.spectrum import spectrum
from rclpy.node import Node

from noise_msgs.msg import AllanCurve as AllanMessage
from noise_msgs.msg import NoiseModel
from noise_msgs.srv import Identify

BAG = "bags/demo_mems"
SPEED = 40
PATIENCE_S = 240.0
SHOWN = "angular_velocity.y"
"""Channel that the pictures show."""
HIDDEN = {"frequency_hz": 23.0, "amplitude": 0.0006}
HIDDEN_S = 240
IMU = ("angular_velocity", "linear_acceleration")


@dataclass(frozen=True)
class Heard:
    """What the live node published."""

    model: NoiseModel
    curves: dict[str, AllanMessage]


def run(*words: str) -> str:
    """Print and run ``ros2 run ...``; return the line, and end the demo where it fails."""
    line = shlex.join(("ros2", "run", *words))
    print(f"make demo: {line}", flush=True)
    done = subprocess.run(["ros2", "run", *words], check=False, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"make demo: that ended with status {done.returncode}\n{done.stderr}")
    return line


def play_live(log: Path) -> Heard:
    """Play the recording into a live node, which writes to a log, and take its model."""
    print("make demo: ros2 run imu_noise_id identify       (live, in the background)", flush=True)
    with log.open("wb") as stream:
        program = subprocess.Popen(
            ["ros2", "run", "imu_noise_id", "identify"], stdout=stream, stderr=subprocess.STDOUT
        )
    rclpy.init()
    node = Node("demo")
    try:
        curves: dict[str, AllanMessage] = {}
        qos = rclpy.qos.QoSProfile(depth=100, durability=rclpy.qos.DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(
            AllanMessage, "/identify/allan", lambda m: curves.update({m.channel: m}), qos
        )
        client = node.create_client(Identify, "/identify/identify")
        if not client.wait_for_service(PATIENCE_S):
            sys.exit(f"make demo: the live node did not start (its words: {log})")
        run("nav_fusion", "play", "--bag", BAG, "--rate", str(SPEED), "--topics", "/imu/data")
        print("make demo: asking the live node for its model", flush=True)
        future = client.call_async(Identify.Request())
        rclpy.spin_until_future_complete(node, future, timeout_sec=PATIENCE_S)
        answer = future.result()
        if answer is None or not answer.success:
            sys.exit(
                f"make demo: no live model: {'no answer' if answer is None else answer.message}"
            )
        wanted = {c.name for c in answer.model.channels}
        until = time.monotonic() + 5.0
        while not wanted <= set(curves) and time.monotonic() < until:
            rclpy.spin_once(node, timeout_sec=0.1)
        return Heard(answer.model, curves)
    finally:
        program.send_signal(signal.SIGINT)
        program.wait()
        node.destroy_node()
        rclpy.try_shutdown()


def hide(model: Path, target: Path) -> None:
    """Write the inertial part of a model with a vibration more."""
    tree = yaml.safe_load(model.read_text(encoding="utf-8"))
    tree["channels"] = [c for c in tree["channels"] if c["name"].startswith(IMU)]
    for channel in tree["channels"]:
        channel.pop("log_covariance", None)
        if channel["name"] == SHOWN:
            channel["effects"].append({"name": "periodic", "parameters": HIDDEN})
    target.write_text(yaml.safe_dump(tree), encoding="utf-8")


def said(report: Path) -> str:
    """Return the verdict at the head of a report."""
    found = re.search(r'<p class="verdict">(.*?)</p>', report.read_text("utf-8"), re.DOTALL)
    return "" if found is None else html.unescape(found.group(1)).strip()


def live_section(heard: Heard, offline: dict[str, Any]) -> Section:
    """Live against offline: the same to the last digit."""
    rows = []
    for channel in heard.model.channels:
        (own,) = [e for e in channel.effects if e.name == "white_noise"]
        other = next(c for c in offline["channels"] if c["name"] == channel.name)
        density = next(e for e in other["effects"] if e["name"] == "white_noise")["parameters"]
        value = density["density"]["value"]
        live = own.parameters[0].value
        rows.append((channel.name, f"{live:.9g}", f"{value:.9g}", own.parameters[0].unit))
    curve = heard.curves[SHOWN]
    kept = next(c for c in offline["channels"] if c["name"] == SHOWN)["allan"]
    plot = figures.lines_figure(
        [
            ("live", np.array(curve.tau_s), np.array(curve.deviation)),
            ("recording", np.array(kept["tau_s"]), np.array(kept["deviation"])),
        ],
        Axis("averaging time (s)", True),
        Axis(f"Allan deviation ({curve.unit})", True),
    )
    samples = heard.model.channels[0].samples
    text = (
        f"{samples:,} messages of /imu/data were played at {SPEED} times their speed; the node "
        "identified them while they came, and once more at the end."
    ).replace(",", "\u2009", 1)
    headings = ("channel", "white noise, live", "white noise, recording", "unit")
    caption = f"{SHOWN}: what the node published, over what the recording gives."
    return Section(
        "1. Live",
        (text,),
        (Figure("Live and recorded", caption, plot, wide=True),),
        (Table("The same core, live and on the bag", headings, tuple(rows), (1, 2)),),
    )


def identified_section(folder: Path, line: str, offline: dict[str, Any]) -> Section:
    """Allan deviation of one channel with each effect's share."""
    channel = next(c for c in offline["channels"] if c["name"] == SHOWN)
    found = channel["allan"]
    arrays = {k: np.array(found[k]) for k in ("tau_s", "deviation", "lower", "upper")}
    rate_hz = channel["rate_hz"]
    model = load_model(folder / "identified" / "model.yaml").channel(SHOWN)
    factors = np.rint(arrays["tau_s"] * rate_hz).astype(np.int64)
    parts = allan_parts(model, arrays["tau_s"], 1.0 / rate_hz)
    total = Part("model", np.sqrt(np.sum([part.values**2 for part in parts], axis=0)))
    unknown = np.zeros(factors.size)
    curve = AllanCurve(
        tau_s=arrays["tau_s"],
        deviation=arrays["deviation"],
        lower=arrays["lower"],
        upper=arrays["upper"],
        confidence=found["confidence"],
        degrees_of_freedom=unknown,
        averaging_factor=factors,
        differences=unknown.astype(np.int64),
    )
    plot = figures.allan_figure(curve, channel["unit"], parts, [total])
    caption = f"{SHOWN}: measured with its interval, each effect's share, and their sum."
    return Section(
        "2. Identified",
        (said(folder / "identified" / "report.html"),),
        (Figure("Allan deviation", caption, plot, wide=True),),
        snippets=(Snippet("The command", line),),
        links=(("The report of the identification", "identified/report.html"),),
    )


def reconciled_section(folder: Path, lines: tuple[str, ...]) -> Section:
    """Spectrum of the hidden effect under the model before and after."""
    series = to_series((r := read_recording(folder / "hidden")).channel(SHOWN), r.start_ns)
    measured = spectrum(series, 100)
    drawn = []
    for when, name in (("before", "identified"), ("after", "reconciled")):
        model = load_model(folder / name / "model.yaml").channel(SHOWN)
        psd = model_psd(model, measured.frequency_hz, series.sample_time_s)
        tones = [f.effect.values()[0] for f in model.effects if f.name == "periodic"]
        plot: Plot = figures.spectrum_figure(
            measured, "rad/s", (), [Part("model", psd)], [float(t) for t in tones]
        )
        drawn.append(Figure(f"Spectrum, {when}", f"{SHOWN} with the {name} model.", plot))
    result = json.loads((folder / "reconciled" / "reconcile.json").read_text(encoding="utf-8"))
    rows = tuple(
        (
            c["name"],
            c["verdict"],
            f"{c['before']['score']:.2f}",
            f"{c['after']['score']:.2f}",
            ", ".join(f"{s['action']} {s['effect']['name']}" for s in c["steps"]),
        )
        for c in result["channels"]
    )
    headings = ("channel", "verdict", "gap before", "gap after", "what was changed")
    return Section(
        "3. Hidden and found",
        (
            f"Another recording was made of the model with one effect more, a vibration of "
            f"{HIDDEN['frequency_hz']:g} Hz on {SHOWN}, which reconcile was not told.",
            said(folder / "reconciled" / "report.html"),
        ),
        tuple(drawn),
        (Table("", headings, rows, (2, 3)),),
        tuple(Snippet("The command", line) for line in lines),
        links=(("The report of the reconciliation", "reconciled/report.html"),),
    )


def fused_sections(folder: Path, fused: str, priced: str) -> tuple[Section, Section]:
    """Filter and error budget."""
    budget = json.loads((folder / "budget" / "budget.json").read_text(encoding="utf-8"))
    scenario = budget["models"][0]["scenarios"][0]
    time_s = np.array(scenario["time_s"])[1:]
    shares = sorted(scenario["shares"], key=lambda s: -s["position"][-1])[:6]
    parts = [
        Part(f"{s['effect']} of the {s['sensor']}", 100 * np.array(s["position"])[1:])
        for s in shares
    ]
    plot = figures.areas_figure(
        time_s, parts, Axis("time (s)", True), Axis("share of the variance (%)", False, 0.0, 100.0)
    )
    return (
        Section(
            "4. Fused",
            (said(folder / "fused" / "report.html"),),
            snippets=(Snippet("The command", fused),),
            links=(("The report of the filter", "fused/report.html"),),
        ),
        Section(
            "5. What the noise costs",
            (said(folder / "budget" / "report.html"),),
            (Figure("Causes of the position error without fixes", "", plot, wide=True),),
            snippets=(Snippet("The command", priced),),
            links=(("The error budget", "budget/report.html"),),
        ),
    )


def main() -> None:
    """Run the steps and write the page."""
    begun = time.monotonic()
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    at = {n: str(folder / n) for n in ("identified", "hidden", "reconciled", "fused", "budget")}
    model, hidden = f"{at['identified']}/model.yaml", folder / "hidden.yaml"
    heard = play_live(folder / "live.log")
    identified = run("imu_noise_id", "identify", "--bag", BAG, "--output", at["identified"])
    hide(Path(model), hidden)
    run("imu_noise_id", "simulate", "--model", str(hidden), "--duration", str(HIDDEN_S),
        "--seed", "1", "--output", at["hidden"])  # fmt: skip
    reconciled = run("imu_noise_id", "reconcile", "--bag", at["hidden"], "--model", model,
                     "--output", at["reconciled"])  # fmt: skip
    fused = run("nav_fusion", "fuse", "--bag", BAG, "--model", model, "--output", at["fused"])
    priced = run("nav_fusion", "budget", "--model", model, "--output", at["budget"])
    offline = json.loads((folder / "identified" / "identify.json").read_text(encoding="utf-8"))
    sections = (
        live_section(heard, offline),
        identified_section(folder, identified, offline),
        reconciled_section(folder, (reconciled,)),
        *fused_sections(folder, fused, priced),
    )
    took = time.monotonic() - begun
    verdict = (
        "A recording was played to the live node and identified, the live and the recorded model "
        "compared; an effect hidden in another recording was sought and named; a filter ran on "
        "the identified model; and its noise was turned into metres and degrees."
    )
    facts = (("recording", BAG), ("all steps", f"{took:.0f} s"))
    page = Page("What the suite does, in one recording", verdict, sections, facts)
    (folder / "report.html").write_text(render(page), encoding="utf-8")
    print(f"make demo: {took:.0f} s; the story is in {(folder / 'report.html').resolve()}")


if __name__ == "__main__":
    main()
