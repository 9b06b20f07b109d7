"""The files that describe the nodes name what the running nodes really have."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python

from helpers.live import Listener, Program

Start = Callable[..., Program]
NODES = [("imu_noise_id", "identify"), ("nav_fusion", "fuse")]
OF_ROSIDL = {"use_sim_time", "start_type_description_service"}


def named(policy: ET.Element, entity: str, what: str) -> set[str]:
    """Names that a profile allows, in full."""
    groups = [g for g in policy.iter(f"{entity}s") if g.get(what) == "ALLOW"]
    return {str(item.text) for group in groups for item in group.iter(entity)}


@pytest.mark.parametrize(("package", "executable"), NODES)
def test_the_policy_allows_what_the_node_does_and_no_more(
    start: Start, listener: Listener, root: Path, package: str, executable: str
) -> None:
    policy = ET.parse(root / "src" / package / "config" / f"{executable}.policy.xml").getroot()
    (profile,) = policy.iter("profile")
    start(package, executable)
    node = listener.node

    def names(ask: Callable[[str, str], list[tuple[str, list[str]]]]) -> set[str]:
        return {name for name, _ in ask(executable, "/")}

    def complete() -> bool:
        return (executable, "/") in node.get_node_names_and_namespaces() and (
            names(node.get_service_names_and_types_by_node) >= named(profile, "service", "reply")
            and names(node.get_publisher_names_and_types_by_node)
            >= named(profile, "topic", "publish")
            and names(node.get_subscriber_names_and_types_by_node)
            >= named(profile, "topic", "subscribe")
        )

    listener.until(complete, f"everything that {executable}.policy.xml allows")
    assert profile.get("node") == executable
    assert names(node.get_publisher_names_and_types_by_node) == named(profile, "topic", "publish")
    assert names(node.get_subscriber_names_and_types_by_node) == named(
        profile, "topic", "subscribe"
    )
    assert names(node.get_service_names_and_types_by_node) == named(profile, "service", "reply")
    assert names(node.get_client_names_and_types_by_node) == named(profile, "service", "request")


@pytest.mark.parametrize(("package", "executable"), NODES)
def test_the_parameter_file_gives_every_parameter_with_its_default_and_says_what_it_is(
    start: Start, listener: Listener, root: Path, package: str, executable: str
) -> None:
    file = root / "src" / package / "config" / f"{executable}.yaml"
    given = yaml.safe_load(file.read_text())["/**"]["ros__parameters"]
    start(package, executable)
    listed = listener.call(
        ListParameters, f"/{executable}/list_parameters", ListParameters.Request()
    )
    names = sorted(set(listed.result.names) - OF_ROSIDL)
    assert names == sorted(given)
    values = listener.call(
        GetParameters, f"/{executable}/get_parameters", GetParameters.Request(names=names)
    )
    found = {n: parameter_value_to_python(v) for n, v in zip(names, values.values, strict=True)}
    assert {n: list(v) if hasattr(v, "typecode") else v for n, v in found.items()} == given
    described = listener.call(
        DescribeParameters,
        f"/{executable}/describe_parameters",
        DescribeParameters.Request(names=names),
    )
    assert all(d.description for d in described.descriptors)
    for line in file.read_text().splitlines():
        if ":" in line and not line.strip().startswith(("#", "/**", "ros__")):
            assert "#" in line, f"not explained: {line}"


def test_what_the_launch_files_name_is_installed(root: Path) -> None:
    files = list((root / "src").glob("*/launch/*.launch.py"))
    pairs = {
        pair
        for file in files
        for pair in re.findall(r'package="(\w+)",\s+executable="(\w+)"', file.read_text())
    }
    assert len(files) >= 2
    assert pairs >= set(NODES)
    for package, executable in pairs:
        assert (root / "install" / "lib" / package / executable).exists()


def sockets_of(pid: int) -> set[str]:
    """Inodes of the sockets of a process and of those that it started."""
    children = [
        c for f in Path(f"/proc/{pid}/task").glob("*/children") for c in f.read_text().split()
    ]
    links = [os.readlink(link) for link in Path(f"/proc/{pid}/fd").iterdir() if link.is_symlink()]
    found = {link[8:-1] for link in links if link.startswith("socket:[")}
    return found.union(*(sockets_of(int(child)) for child in children))


@pytest.mark.parametrize(("package", "executable"), NODES)
def test_a_node_listens_on_nothing_but_dds(
    start: Start, listener: Listener, ros_domain_id: int, package: str, executable: str
) -> None:
    program = start(package, executable)
    listener.until(
        lambda: (executable, "/") in listener.node.get_node_names_and_namespaces(), "the node"
    )
    mine = sockets_of(program.process.pid)
    listening, ports = [], []
    for protocol in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/net/{protocol}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] not in mine:
                continue
            port = int(fields[1].split(":")[1], 16)
            if protocol.startswith("tcp") and fields[3] == "0A":
                listening.append(port)
            elif protocol.startswith("udp"):
                ports.append(port)
    assert not listening
    first = 7400 + 250 * ros_domain_id  # RTPS 2.5, 9.6.2.3: the domain's ports
    known = [port for port in ports if first <= port < first + 250]
    assert known, ports
