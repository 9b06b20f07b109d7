"""``simulate``: the same seed gives the same bag, and the bag is the model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from imu_noise_id.bags import read_recording

from helpers.commands import DENSITIES, Run


def _simulate(run: Run, model: Path, seed: int, output: Path) -> None:
    done = run("simulate", "--model", model, "--duration", 20, "--seed", seed, "--output", output)
    assert done.status == 0, done.err


def test_a_seed_gives_the_same_samples_and_another_gives_others(
    run: Run, model_path: Path, tmp_path: Path
) -> None:
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        _simulate(run, model_path, seed, tmp_path / name)
    a, b, c = (read_recording(tmp_path / name) for name in "abc")
    for one, same, other in zip(a.channels, b.channels, c.channels, strict=True):
        np.testing.assert_array_equal(one.values, same.values)
        assert np.any(one.values != other.values)


def test_the_bag_holds_the_model_with_its_rate_and_mean(
    run: Run, model_path: Path, tmp_path: Path
) -> None:
    _simulate(run, model_path, 3, tmp_path / "bag")
    recording = read_recording(tmp_path / "bag")
    assert recording.notes == ()
    for channel in recording.channels:
        assert channel.values.size == 2000
        assert abs(channel.rate_hz - 100.0) < 1e-6
        sigma = DENSITIES[channel.name.split(".")[0]] * 10.0
        assert abs(channel.values.mean() - 0.01) < 5.0 * sigma / np.sqrt(2000.0)
        assert abs(channel.values.std() / sigma - 1.0) < 5.0 / np.sqrt(4000.0)


def test_what_a_hand_typed_model_lacks_is_said(run: Run, tmp_path: Path) -> None:
    model = tmp_path / "typed.yaml"
    for mean, coefficient, says in (
        (0.0, None, ["no gravity in the bag"]),
        (9.81, 1e-3, ["temperature has no course"]),
        (9.81, None, []),
    ):
        text = "channels:\n- name: linear_acceleration.z\n  effects:\n"
        text += "  - {name: white_noise, parameters: {density: 1e-3}}\n"
        if coefficient:
            text += f"  - {{name: temperature, parameters: {{coefficient: {coefficient}}}}}\n"
        model.write_text(text + (f"  mean: {mean}\n" if mean else ""), encoding="utf-8")
        output = tmp_path / "bag"
        done = run("simulate", "--model", model, "--duration", 2, "--seed", 1, "--output", output)
        assert done.status == 0
        assert done.err.count("\n") == len(says)
        assert all(line in done.err for line in says)


def test_what_cannot_be_simulated_gets_one_line(run: Run, model_path: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.yaml"
    broken.write_text("channels:\n- name: gyro\n", encoding="utf-8")
    base = ("--seed", 1, "--output", tmp_path / "bag")
    for arguments, says in (
        (("--model", broken, "--duration", 5, *base), "line 2"),
        (("--model", tmp_path / "none.yaml", "--duration", 5, *base), "none.yaml"),
        (("--model", model_path, "--duration", 1e-4, *base), "simulate longer"),
        (("--model", model_path, "--duration", 0, *base), "--duration"),
        (("--model", model_path, "--duration", 5, "--seed", -1, "--output", "x"), "--seed"),
        (("--model", model_path, "--duration", 5), "--seed"),
    ):
        done = run("simulate", *arguments)
        assert done.status == 2
        assert done.err.count("\n") == 1
        assert says in done.err
    assert not (tmp_path / "bag").exists()
