"""What is wrong in a parameter file is said with its line, before the node starts."""

import pytest
from imu_noise_id.errors import InputError
from imu_noise_id.ros.identify_node import SETTINGS
from imu_noise_id.ros.parameter_files import check_arguments


@pytest.fixture
def check(tmp_path):
    def call(text, *more, pattern="identify"):
        path = tmp_path / "p.yaml"
        lines = "".join(f"    {line}\n" for line in text.split("\n"))
        path.write_text(f"{pattern}:\n  ros__parameters:\n{lines}")
        return check_arguments(["--ros-args", "--params-file", str(path), *more], "identify",
                               SETTINGS)  # fmt: skip

    return call


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        ("imu_topic: /a\nbufer_s: 100.0", 4, "unknown parameter 'bufer_s': known are imu_topic"),
        ("buffer_s: 1.0", 3, "must be between 30 and 86400, not 1"),
        ("buffer_s: .nan", 3, "must be a finite number"),
        ("buffer_s: often", 3, "must be a finite number, not 'often'"),
        ("imu_topic: /a\n\nbuffer_s: 100", 5, "must be decimal, as 100.0 is, not 100"),
        ("queue_depth: 300.5", 3, "must be a whole number, not 300.5"),
        ("buffer_s: 100.0\nbuffer_s: 200.0", 4, "the key 'buffer_s' stands twice"),
        ("buffer_s: [1.0", 4, "not YAML"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(check, text, line, said):
    with pytest.raises(InputError) as caught:
        check(text)
    assert f"p.yaml, line {line}: " in str(caught.value)
    assert said in str(caught.value)


@pytest.mark.parametrize("pattern", ["/**", "/*", "/**/identify"])
def test_what_may_be_meant_for_another_node_is_only_said(check, pattern):
    (said,) = check("robot: r2d2\nbuffer_s: 100.0", pattern=f'"{pattern}"') or ("",)
    assert "line 3: unknown parameter 'robot'" in said


@pytest.mark.parametrize(
    ("pattern", "more"),
    [
        ("fuse", ()),
        ("/robot/identify", ()),
        ("identify", ("-r", "__node:=other")),
        ("identify", ("-r", "__ns:=/robot")),
    ],
)
def test_sections_of_other_nodes_are_passed_over(check, pattern, more):
    assert check("bufer_s: 1.0", *more, pattern=pattern) == ()


def test_a_namespace_may_be_nested(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text("robot:\n  identify:\n    ros__parameters:\n      bufer_s: 1.0\n")
    arguments = ["--params-file", str(path), "-r", "__ns:=/robot"]
    with pytest.raises(InputError, match="line 4"):
        check_arguments(arguments, "identify", SETTINGS)


def test_an_argument_that_names_no_parameter_is_refused():
    with pytest.raises(InputError, match=r"-p bufer_s:=3\.0: unknown parameter"):
        check_arguments(["--ros-args", "-p", "bufer_s:=3.0"], "identify", SETTINGS)
    assert not check_arguments(["-p", "use_sim_time:=true"], "identify", SETTINGS)
    assert not check_arguments(["-p", "identify:buffer_s:=60.0"], "identify", SETTINGS)


def test_a_file_that_is_missing_is_named():
    with pytest.raises(InputError, match=r"nowhere\.yaml: cannot be read"):
        check_arguments(["--params-file", "nowhere.yaml"], "identify", SETTINGS)
