# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
Start race control and the timekeeper: ros2 launch evgp_rcs rcs.launch.py roster:=karts.yaml .

The timekeeper ends with race control, but race control does not need the timekeeper.
"""

from evgp_node.restarting import PREFIX
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent
from launch.events import matches_action
from launch.events.process import ShutdownProcess
from launch.substitutions import EnvironmentVariable, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


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
        prefix=PREFIX,
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
        prefix=PREFIX,  # karts stay stopped until race control is restarted
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
