"""The parameter file of a node holds exactly the parameters that the running node has."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import rclpy
import yaml
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import parameter_value_to_python

ROOT = Path(__file__).resolve().parents[2]
NODES = [("imu_noise_id", "identify"), ("nav_fusion", "fuse")]
OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides")


@contextmanager
def domain(arguments: list[str] | None = None) -> Iterator[rclpy.Context]:
    """Give a context on the domain that the environment names now."""
    context = rclpy.Context()
    rclpy.init(args=arguments, context=context)
    try:
        yield context
    finally:
        rclpy.shutdown(context=context)


def parameters_of(name: str) -> dict[str, object]:
    """Ask a running node for all its parameters and their values."""
    with domain() as context:
        asking = rclpy.create_node("asking", context=context)
        executor = SingleThreadedExecutor(context=context)

        def call(kind: type, service: str, request: object) -> object:
            client = asking.create_client(kind, f"/{name}/{service}")
            assert client.wait_for_service(timeout_sec=60.0), f"/{name}/{service} does not answer"
            future = client.call_async(request)
            rclpy.spin_until_future_complete(asking, future, executor, timeout_sec=30.0)
            return future.result()

        listed = call(ListParameters, "list_parameters", ListParameters.Request())
        names = [n for n in listed.result.names if not n.startswith(OF_RCLPY)]
        got = call(GetParameters, "get_parameters", GetParameters.Request(names=names))
        asking.destroy_node()
    values = map(parameter_value_to_python, got.values)
    return dict(zip(names, values, strict=True))


@pytest.mark.parametrize(("package", "node"), NODES)
def test_file_and_node_have_the_same_parameters(package, node, ros_env, ros_here):
    text = (ROOT / "src" / package / "config" / f"{node}.yaml").read_text()
    written = yaml.safe_load(text)["/**"]["ros__parameters"]
    command = ["ros2", "run", package, node]
    with subprocess.Popen(command, env=ros_env, stderr=subprocess.PIPE, text=True) as running:
        try:
            declared = parameters_of(node)
        finally:
            running.send_signal(signal.SIGINT)
            running.communicate(timeout=30)
    assert declared == written


@pytest.mark.parametrize(("package", "node"), NODES)
def test_every_parameter_is_explained(package: str, node: str):
    path = ROOT / "src" / package / "config" / f"{node}.yaml"
    for line in path.read_text().splitlines()[4:]:
        assert line.strip() == "" or "# " in line, f"{path.name}: no comment in: {line}"


@pytest.mark.parametrize(("package", "node"), NODES)
def test_the_file_is_installed_and_read_by_ros(package, node, tmp_path, ros_here):
    path = ROOT / "install/share" / package / "config" / f"{node}.yaml"
    written = yaml.safe_load(path.read_text())["/**"]["ros__parameters"]
    arguments = ["--ros-args", "--params-file", str(path)]
    with domain(arguments) as context:
        reader = rclpy.create_node(
            node, context=context, automatically_declare_parameters_from_overrides=True
        )
        read = {name: reader.get_parameter(name).value for name in written}
        reader.destroy_node()
    assert read == written
