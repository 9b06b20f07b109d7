"""How a node of this suite runs: executor, signals, a clean end."""

from __future__ import annotations

import gc
import importlib
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import Any

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from imu_noise_id.errors import InputError
from imu_noise_id.ros.parameter_files import check_arguments
from imu_noise_id.ros.parameters import Setting

_WAKE_S = 0.05
BAD_INPUT = 2
BAD_ARGUMENTS = (
    rclpy_implementation.RCLError,
    rclpy_implementation.UnknownROSArgsError,
)


def make_executor() -> Executor:
    """The events executor where this rclpy has one (a third of the CPU), else the plain one."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


def message_class(name: str) -> Any:
    """Class of ``sensor_msgs/msg/Imu``.

    Raises
    ------
    ImportError
        When its package is not installed or has no such message.
    """
    package, kind, short = name.split("/")
    module = importlib.import_module(f"{package}.{kind}")
    try:
        return getattr(module, short)
    except AttributeError as error:
        raise ImportError(f"{package} has no message {short}") from error


class Stop:
    """Whether SIGINT or SIGTERM has come; a second one ends the process at once."""

    def __init__(self) -> None:
        self.asked = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        del frame
        self.asked = True
        signal.signal(number, signal.SIG_DFL)


def run_node(
    make: Callable[[], Node], argv: Sequence[str] | None, name: str, settings: Sequence[Setting]
) -> int:
    """Spin a node until SIGINT or SIGTERM; return the exit status.

    Parameters
    ----------
    make : callable
        Makes the node; an `InputError` from it is one line on stderr and status 2.
    argv : sequence of str, optional
        ``--ros-args ...``; none where None.
    name : str
        The node's, where no argument gives another.
    settings : sequence of Setting
        Its parameters, which files and arguments are checked against first.
    """
    try:
        unknown = check_arguments(list(argv or []), name, settings)
        rclpy.init(args=list(argv or []), signal_handler_options=SignalHandlerOptions.NO)
        stop = Stop()
        node = make()
    except (InputError, ParameterException, *BAD_ARGUMENTS) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        rclpy.try_shutdown()
        return BAD_INPUT
    for line in unknown:
        node.get_logger().warning(line)
    executor = make_executor()
    executor.add_node(node)
    gc.collect()
    gc.freeze()  # what is there by now stays: looking through it again and again would cost 30 ms
    try:
        while rclpy.ok() and not stop.asked:
            executor.spin_once(_WAKE_S)
    finally:
        # in this order: nothing is spun any more, workers end, then the node, then the context
        executor.remove_node(node)
        executor.shutdown()
        if hasattr(node, "close"):
            node.close()
        node.destroy_node()
        rclpy.try_shutdown()
    return 0
