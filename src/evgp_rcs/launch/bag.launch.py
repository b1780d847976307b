# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Record a race with rosbag2: ros2 launch evgp_rcs bag.launch.py output:=race1 .

It needs rosbag2 (apt: ros-jazzy-ros2bag), which nothing else here does. It records topics only, on
the same graph as race control. `rcs_record mcap` makes a bag of a race afterwards, without it.
"""

from evgp_node.graph import bind_graph
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

TOPICS = ('/rcs/race', '/rcs/events', '/rcs/timekeeper/results', '/diagnostics')


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` looks for."""
    # It is on the same graph as race control, by the same settings; they go through the
    # environment, which the recorder inherits.
    bind_graph()
    config = PathJoinSubstitution([FindPackageShare('evgp_rcs'), 'config'])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'output', description='The folder of the bag; it must not exist yet.'
            ),
            DeclareLaunchArgument(
                'qos_file',
                default_value=PathJoinSubstitution([config, 'bag_qos.yaml']),
                description='How the latched topics are listened to.',
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
