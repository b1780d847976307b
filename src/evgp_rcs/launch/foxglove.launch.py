# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Show a race that is going on in Foxglove: ros2 launch evgp_rcs foxglove.launch.py .

It needs the package foxglove_bridge (apt: ros-jazzy-foxglove-bridge), which nothing else here
does. By default that package listens on every address, and lets whoever connects call services,
those that start karts too. Here it listens on this machine only, and shows topics, no more.
"""

from evgp_node.graph import bind_graph
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

NOTHING = ['(?!)']
"""A list of regular expressions that matches no name; ROS does not take an empty list."""


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` looks for."""
    # It is on the same graph as race control, by the same settings; they go through the
    # environment, which the bridge inherits.
    bind_graph()
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'port', default_value='8765', description='The TCP port for Foxglove.'
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
