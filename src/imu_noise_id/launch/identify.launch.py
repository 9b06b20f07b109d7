"""Run the identify node, and play a recording beside it where one is given.

``ros2 launch imu_noise_id identify.launch.py``
``ros2 launch imu_noise_id identify.launch.py bag:=/path/to/bag rate:=10.0``
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

DEFAULT_PARAMETERS = PathJoinSubstitution(
    [FindPackageShare("imu_noise_id"), "config", "identify.yaml"]
)
ARGUMENTS = [
    DeclareLaunchArgument(
        "namespace", default_value="", description="Namespace of the node, e.g. the robot's name"
    ),
    DeclareLaunchArgument(
        "use_sim_time",
        default_value="false",
        description="Take the time from /clock (a simulation, or a recording that is played)",
    ),
    DeclareLaunchArgument(
        "params_file",
        default_value=DEFAULT_PARAMETERS,
        description="YAML file of the node's parameters; every one is explained in the default",
    ),
    DeclareLaunchArgument(
        "log_level", default_value="info", description="debug, info, warn, error or fatal"
    ),
    DeclareLaunchArgument(
        "bag", default_value="", description="Recording to play on its topics; empty: none"
    ),
    DeclareLaunchArgument(
        "rate", default_value="1.0", description="How many times as fast the recording is played"
    ),
]


def generate_launch_description() -> LaunchDescription:
    identify = Node(
        package="imu_noise_id",
        executable="identify",
        name="identify",
        namespace=LaunchConfiguration("namespace"),
        parameters=[
            LaunchConfiguration("params_file"),
            {"use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)},
        ],
        ros_arguments=["--log-level", LaunchConfiguration("log_level")],
        output="screen",
    )
    play = Node(
        package="nav_fusion",
        executable="play",
        name="play",
        arguments=["--bag", LaunchConfiguration("bag"), "--rate", LaunchConfiguration("rate")],
        condition=IfCondition(NotEqualsSubstitution(LaunchConfiguration("bag"), "")),
        output="screen",
    )
    return LaunchDescription([*ARGUMENTS, identify, play])
