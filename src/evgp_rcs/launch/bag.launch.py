# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Record a race with rosbag2: ros2 launch evgp_rcs bag.launch.py output:=race1 .

Only this launch file needs rosbag2 (apt: ros-jazzy-ros2bag). It records only topics, on the same
graph as race control. `rcs_record mcap` makes a bag of a race afterwards without rosbag2.
"""

from evgp_node.graph import bind_graph
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

TOPICS = ('/rcs/race', '/rcs/events', '/rcs/timekeeper/results', '/diagnostics')


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` looks for."""
    # The recorder inherits race control's settings of the graph through the environment.
    bind_graph()
    config = PathJoinSubstitution([FindPackageShare('evgp_rcs'), 'config'])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'output', description='Folder of the bag, which must not exist yet.'
            ),
            DeclareLaunchArgument(
                'qos_file',
                default_value=PathJoinSubstitution([config, 'bag_qos.yaml']),
                description='File with the QoS of the latched topics.',
            ),
            ExecuteProcess(
                cmd=[
                    *('ros2', 'bag', 'record', '--disable-keyboard-controls'),
                    *('--output', LaunchConfiguration('output')),
                    *('--qos-profile-overrides-path', LaunchConfiguration('qos_file')),
                    *('--topics', *TOPICS),
                ],
                output='screen',
            ),
        ]
    )
