# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Aggregate race control's diagnostics: ros2 launch evgp_rcs aggregator.launch.py .

It needs the package diagnostic_aggregator (apt: ros-jazzy-diagnostic-aggregator), which nothing
else here does. It publishes /diagnostics_agg, on the same graph as race control.
"""

from evgp_node.graph import bind_graph
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` looks for."""
    # The aggregator inherits race control's settings of the graph through the environment.
    bind_graph()
    config = PathJoinSubstitution([FindPackageShare('evgp_rcs'), 'config'])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'analyzers_file',
                default_value=PathJoinSubstitution([config, 'analyzers.yaml']),
                description='File of the analyzers.',
            ),
            Node(
                package='diagnostic_aggregator',
                executable='aggregator_node',
                name='analyzers',
                parameters=[LaunchConfiguration('analyzers_file')],
                output='screen',
            ),
        ]
    )
