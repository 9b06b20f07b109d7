"""A model file comes back to the last bit, and what is wrong in it is named with its line."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.effects.bandwidth_limit import BandwidthLimit, DigitalBandwidthLimit
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.errors import InputError
from imu_noise_id.model import (
    ChannelModel,
    Estimate,
    FittedEffect,
    NoiseModel,
    TemperatureCourse,
    UpperBound,
)
from imu_noise_id.model_file import effect_tree, load_model, save_model

GYRO = "angular_velocity.x"
LOW_PASS = (
    "      - {{name: bandwidth_limit, {}parameters: {{cutoff_hz: 30.1, order: 2, damping: 0.7}}}}\n"
)


def _write(folder: Path, text: str) -> Path:
    path = folder / "model.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def _typed(effects: str) -> str:
    return f"format: model/1\nchannels:\n  - name: {GYRO}\n    effects:\n{effects}"


def _awkward(rng: np.random.Generator) -> float:
    """A float with all its digits, of any size."""
    return float(rng.uniform(0.1, 1.0) * 10.0 ** rng.integers(-300, 300))


def test_every_float_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        numbers = [_awkward(rng) for _ in range(4)]
        estimate = Estimate(*numbers[:2], *sorted(numbers[2:]), "rad/s/sqrt(Hz)")
        model = NoiseModel(
            (
                ChannelModel(
                    GYRO,
                    "/imu/<script>: {x}",
                    "rad/s",
                    _awkward(rng),
                    -_awkward(rng),
                    (FittedEffect(WhiteNoise(numbers[0]), (estimate,), "a 'note': # yes"),),
                    np.array([[_awkward(rng)]]),
                    _awkward(rng),
                    (UpperBound("white_noise", "density", "rad/s/sqrt(Hz)", 1e-5, "why: short"),),
                ),
            ),
            TemperatureCourse(np.array([0.0, 0.1]), np.array([20.0, 1.0 / 3.0])),
            "a bag",
            ("first", "second: ja, ä"),
        )
        save_model(model, tmp_path / "model.yaml")
        again = load_model(tmp_path / "model.yaml")
        np.testing.assert_array_equal(
            again.channels[0].log_covariance, model.channels[0].log_covariance
        )
        assert again.temperature is not None
        np.testing.assert_array_equal(
            again.temperature.temperature_degc, model.temperature.temperature_degc
        )
        save_model(again, tmp_path / "again.yaml")
        assert (tmp_path / "again.yaml").read_bytes() == (tmp_path / "model.yaml").read_bytes()
        assert again.channels[0].effects == model.channels[0].effects
        assert again.channels[0].bounds == model.channels[0].bounds


def test_a_hand_typed_file_needs_only_names_and_values(tmp_path: Path) -> None:
    for value in ("1.0e-4", "1e-4", "'1e-4'", "0.0001", "{value: 1e-4}"):
        text = f"channels:\n- name: {GYRO}\n  effects:\n  - name: white_noise\n"
        path = _write(tmp_path, text + f"    parameters: {{density: {value}}}\n")
        model = load_model(path)
        assert model.channels[0].effects[0].effect == WhiteNoise(1e-4)
        assert model.channels[0].topic == "/imu/data"
        assert model.channels[0].unit == "rad/s"


@pytest.mark.parametrize("level", ["effect", "channel", "file"])
def test_a_one_sided_density_is_divided_by_the_root_of_two(tmp_path: Path, level: str) -> None:
    mark = {key: "one_sided: true" if key == level else "" for key in ("effect", "channel", "file")}
    text = f"""{mark["file"]}
channels:
  - name: {GYRO}
    {mark["channel"]}
    effects:
      - name: white_noise
        {mark["effect"]}
        parameters:
          density: {{value: 2.0e-4, lower: 1.0e-4, upper: 3.0e-4, unit: rad/s/sqrt(Hz)}}
"""
    fitted = load_model(_write(tmp_path, text)).channels[0].effects[0]
    assert fitted.effect == WhiteNoise(2.0e-4 / math.sqrt(2.0))
    assert fitted.estimates[0].upper == 3.0e-4 / math.sqrt(2.0)


EFFECT = "      - name: white_noise\n        parameters: {density: 1.0e-4}\n"

WRONG = [
    ("channels: [\n", 2, "not YAML"),
    ("", None, "empty"),
    ("- 1\n", 1, "mapping"),
    ("format: model/9\nchannels: []\n", 1, "model/1"),
    ("format: model/1\n", 1, "channels"),
    ("channels: []\n", 1, "empty"),
    ("format: model/1\nchanels: []\n", 2, "unknown key 'chanels'"),
    ("channels:\n- name: gyro.x\n", 2, "unknown channel 'gyro.x'"),
    (f"channels:\n- name: {GYRO}\n- name: {GYRO}\n", 3, "twice"),
    (f"channels:\n- name: {GYRO}\n  name: {GYRO}\n", 3, "stands twice"),
    (f"channels:\n- name: {GYRO}\n  unit: deg/s\n", 3, "rad/s"),
    (f"channels:\n- name: {GYRO}\n  rate_hz: -5\n", 3, "above 0"),
    (f"channels:\n- name: {GYRO}\n  mean: .nan\n", 3, "finite"),
    (_typed("      - name: white_nose\n        parameters: {}\n"), 5, "unknown effect"),
    (_typed("      - name: white_noise\n"), 5, "without 'parameters'"),
    (_typed("      - name: white_noise\n        density: 1e-4\n"), 6, "under 'parameters'"),
    (_typed("      - name: white_noise\n        parameters: {sigma: 1}\n"), 6, "density"),
    (_typed("      - name: white_noise\n        parameters: {density: -1}\n"), 6, "above 0"),
    (_typed("      - name: white_noise\n        parameters: {density: 0}\n"), 6, "above 0"),
    (_typed("      - name: white_noise\n        parameters: {density: .inf}\n"), 6, "finite"),
    (_typed("      - name: white_noise\n        parameters: {density: 1_0}\n"), 6, "finite"),
    (_typed("      - name: white_noise\n        parameters: {density: abc}\n"), 6, "'abc'"),
    (
        _typed("      - name: white_noise\n        parameters: {density: {value: 1, unit: deg}}\n"),
        6,
        "rad/s/sqrt(Hz)",
    ),
    (
        _typed(
            "      - name: white_noise\n        parameters: {density: {value: 1,\n std_error: -1}}"
        ),
        7,
        "0 or more",
    ),
    (
        _typed(
            "      - name: white_noise\n"
            "        parameters: {density: {value: 1, lower: 2,\n upper: 1}}"
        ),
        6,
        "above upper",
    ),
    (_typed(EFFECT) + "    log_covariance: [[1, 2]]\n", 7, "square"),
    (_typed(EFFECT) + "    bounds: [{name: white_noise}]\n", 7, "parameter"),
    (_typed(EFFECT) + "temperature: {time_s: [0, 1], temperature_degc: [20]}\n", 7, "as many"),
    (_typed(EFFECT) + "notes: !!python/object/apply:os.system [echo]\nx: 1\n", 8, "unknown key"),
    (_typed(LOW_PASS.format("form: analog, ")), 5, "no form 'analog' (forms: 'digital')"),
    (_typed("      - {name: white_noise, form: digital, parameters: {density: 1}}"), 5, "no form"),
    ("format: two\n  \n  lines\n", 1, "not model/1"),
    ("a: &a [1]\nb: *a\n", 2, "aliases"),
    ("[" * 40 + "]" * 40, 1, "nested"),
]


@pytest.mark.parametrize(("text", "line", "says"), WRONG)
def test_what_is_wrong_is_named_with_file_and_line(
    tmp_path: Path, text: str, line: int | None, says: str
) -> None:
    path = _write(tmp_path, text)
    with pytest.raises(InputError) as caught:
        load_model(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"{path}, line {line}: " if line else f"{path}: ")
    assert says in message


def test_a_digital_low_pass_comes_back_as_one_and_the_other_form_as_itself(tmp_path: Path) -> None:
    text = _typed("".join(LOW_PASS.format(form) for form in ("form: digital, ", "")))
    model = load_model(_write(tmp_path, text))
    digital, other = (fitted.effect for fitted in model.channels[0].effects)
    assert (digital, other) == (DigitalBandwidthLimit(30.1, 2, 0.7), BandwidthLimit(30.1, 2, 0.7))
    save_model(model, tmp_path / "again.yaml")
    again = load_model(tmp_path / "again.yaml")
    assert again.channels[0].effects == model.channels[0].effects
    for fitted in model.channels[0].effects:
        assert list(effect_tree(fitted)["parameters"]) == ["cutoff_hz", "order", "damping"]


def test_a_missing_file_a_folder_and_a_binary_file_get_one_line(tmp_path: Path) -> None:
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x01")
    for name, says in (("none.yaml", "No such file"), ("", "directory"), ("binary", "UTF-8")):
        with pytest.raises(InputError, match=says):
            load_model(tmp_path / name)


def test_a_model_that_cannot_be_written_leaves_the_old_file(tmp_path: Path) -> None:
    model = load_model(_write(tmp_path, _typed(EFFECT)))
    blocked = tmp_path / "file"
    blocked.write_text("old", encoding="utf-8")
    with pytest.raises(InputError, match="cannot be written"):
        save_model(model, blocked / "model.yaml")
    assert blocked.read_text(encoding="utf-8") == "old"
