# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts a kart's bridge and stack: kart.launch.py host:=10.0.0.1 odom:=/odom package:=..."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` looks for."""
    launch = PathJoinSubstitution([FindPackageShare('evgp_kart_bridge'), 'launch'])
    return LaunchDescription(
        [
            # All arguments of the included file are also arguments of this one; launch wants those
            # without a default passed on.
            DeclareLaunchArgument('host', description='The address of race control.'),
            IncludeLaunchDescription(
                PythonLaunchDescriptionSource(
                    PathJoinSubstitution([launch, 'kart_bridge.launch.py'])
                ),
                launch_arguments=[('host', LaunchConfiguration('host'))],
            ),
            DeclareLaunchArgument(
                'package',
                default_value='evgp_kart_bridge',
                description='The package of the stack.',
            ),
            DeclareLaunchArgument(
                'executable',
                default_value='shortest_stack',
                description='The executable of the stack.',
            ),
            # The stack is not restarted, because you should first find out why it ended.
            Node(
                package=LaunchConfiguration('package'),
                executable=LaunchConfiguration('executable'),
                namespace=LaunchConfiguration('namespace'),
                additional_env={'ROS_DOMAIN_ID': LaunchConfiguration('domain_id')},
                output='screen',
            ),
        ]
    )
