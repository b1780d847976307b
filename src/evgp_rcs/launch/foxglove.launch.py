# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Show a live race in Foxglove: ros2 launch evgp_rcs foxglove.launch.py .

Only this launch file needs the package foxglove_bridge (apt: ros-jazzy-foxglove-bridge). By
default, that package listens on every address and lets anyone call services, including those that
start karts. Here it listens only on this machine, and shows only topics.
"""

from evgp_node.graph import bind_graph
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

NOTHING = ['(?!)']
"""Regular expressions that match no name, since ROS does not accept an empty list."""


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` looks for."""
    # The bridge inherits race control's settings of the graph through the environment.
    bind_graph()
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'port', default_value='8765', description='TCP port for Foxglove.'
            ),
            Node(
                package='foxglove_bridge',
                executable='foxglove_bridge',
                name='foxglove_bridge',
                parameters=[
                    {
                        'address': '127.0.0.1',
                        'port': LaunchConfiguration('port'),
                        'capabilities': ['connectionGraph'],
                        'topic_whitelist': ['.*/race', '.*/events', '.*/results', '/diagnostics'],
                        'service_whitelist': NOTHING,
                        'param_whitelist': NOTHING,
                        'client_topic_whitelist': NOTHING,
                        'asset_uri_allowlist': NOTHING,
                    }
                ],
                output='screen',
            ),
        ]
    )
