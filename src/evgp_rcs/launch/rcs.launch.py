# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Start race control and the timekeeper: ros2 launch evgp_rcs rcs.launch.py roster:=karts.yaml .

The timekeeper ends with race control, but race control does not need the timekeeper.
"""

import sys

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent
from launch.events import matches_action
from launch.events.process import ShutdownProcess
from launch.substitutions import EnvironmentVariable, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

RESTARTING = f'{sys.executable} -m evgp_node.restarting'
"""Restarts a program that dies, as `make run` does. Karts stay stopped until then."""


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` looks for."""
    config = PathJoinSubstitution([FindPackageShare('evgp_rcs'), 'config'])
    of_timing = PathJoinSubstitution([FindPackageShare('evgp_timing'), 'config'])
    roster = {'roster': ParameterValue(LaunchConfiguration('roster'), value_type=str)}
    environment = {
        'EVGP_GRAPH_INTERFACE': LaunchConfiguration('officials'),
        'ROS_DOMAIN_ID': LaunchConfiguration('domain_id'),
    }
    timekeeper = Node(
        package='evgp_timing',
        executable='timekeeper',
        exec_name='timekeeper',
        name='timekeeper',
        namespace=[LaunchConfiguration('namespace'), '/rcs'],
        parameters=[LaunchConfiguration('timing_params_file'), roster],
        additional_env=environment,
        output='screen',
        prefix=RESTARTING,
    )
    race_control = Node(
        package='evgp_rcs',
        executable='rcs_node',
        exec_name='rcs_node',
        name='rcs',
        namespace=LaunchConfiguration('namespace'),
        parameters=[LaunchConfiguration('params_file'), roster],
        additional_env=environment,
        output='screen',
        prefix=RESTARTING,
        on_exit=EmitEvent(event=ShutdownProcess(process_matcher=matches_action(timekeeper))),
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'roster',
                default_value=PathJoinSubstitution([config, 'karts.yaml']),
                description='File that lists the karts, for both.',
            ),
            DeclareLaunchArgument(
                'params_file',
                default_value=PathJoinSubstitution([config, 'rcs.yaml']),
                description="File of race control's parameters.",
            ),
            DeclareLaunchArgument(
                'timing_params_file',
                default_value=PathJoinSubstitution([of_timing, 'timekeeper.yaml']),
                description="File of the timekeeper's parameters.",
            ),
            DeclareLaunchArgument(
                'namespace', default_value='', description='Namespace of race control.'
            ),
            # By default apart from all other graphs (docs/security.md).
            DeclareLaunchArgument(
                'officials',
                default_value=EnvironmentVariable('EVGP_GRAPH_INTERFACE', default_value=''),
                description='IPv4 address of the interface that officials on other machines '
                'use; empty if there are none.',
            ),
            DeclareLaunchArgument(
                'domain_id',
                default_value=EnvironmentVariable('ROS_DOMAIN_ID', default_value='0'),
                description='ROS domain, 0 to 101.',
            ),
            race_control,
            timekeeper,
        ]
    )
