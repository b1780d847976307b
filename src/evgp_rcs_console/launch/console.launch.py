# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Open the officials' console: ros2 launch evgp_rcs_console console.launch.py ."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` looks for."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'namespace', default_value='', description='Namespace of race control.'
            ),
            # The same two settings as race control's (docs/security.md).
            DeclareLaunchArgument(
                'officials',
                default_value=EnvironmentVariable('EVGP_GRAPH_INTERFACE', default_value=''),
                description="IPv4 address of this machine's interface to race control; "
                'empty: race control is on this machine.',
            ),
            DeclareLaunchArgument(
                'domain_id',
                default_value=EnvironmentVariable('ROS_DOMAIN_ID', default_value='0'),
                description='ROS domain, 0 to 101.',
            ),
            DeclareLaunchArgument(
                'official',
                default_value='',
                description='Your name, sent with every command; empty: the saved name, or '
                'the one that you choose in the window.',
            ),
            Node(
                package='evgp_rcs_console',
                executable='rcs_gui',
                namespace=LaunchConfiguration('namespace'),
                additional_env={
                    'EVGP_GRAPH_INTERFACE': LaunchConfiguration('officials'),
                    'ROS_DOMAIN_ID': LaunchConfiguration('domain_id'),
                },
                parameters=[
                    {'official': ParameterValue(LaunchConfiguration('official'), value_type=str)}
                ],
                output='screen',
            ),
        ]
    )
