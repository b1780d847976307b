"""Open the officials' console: ros2 launch evgp_rcs_console console.launch.py ."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` looks for."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'namespace', default_value='', description='Where race control stands.'
            ),
            Node(
                package='evgp_rcs_console',
                executable='rcs_gui',
                namespace=LaunchConfiguration('namespace'),
                output='screen',
            ),
        ]
    )
