# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Starts a kart's bridge: ros2 launch evgp_kart_bridge kart_bridge.launch.py host:=10.0.0.1 ."""

from evgp_node.restarting import PREFIX
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import EnvironmentVariable, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return the description that `ros2 launch` looks for."""
    config = PathJoinSubstitution([FindPackageShare('evgp_kart_bridge'), 'config'])
    return LaunchDescription(
        [
            DeclareLaunchArgument('host', description='The address of race control.'),
            DeclareLaunchArgument(
                'odom',
                default_value='~/odom',
                description="The topic of the kart's odometry, nav_msgs/msg/Odometry. The bridge "
                'requires odometry if you set a topic other than ~/odom.',
            ),
            DeclareLaunchArgument(
                'params_file',
                default_value=PathJoinSubstitution([config, 'kart_bridge.yaml']),
                description='The parameter file.',
            ),
            DeclareLaunchArgument(
                'namespace', default_value='', description='The namespace of the node.'
            ),
            # By default, other computers cannot reach the graph (docs/security.md).
            DeclareLaunchArgument(
                'graph_interface',
                default_value=EnvironmentVariable('EVGP_GRAPH_INTERFACE', default_value=''),
                description="This computer's IPv4 address on the network to the kart's other "
                'computers. Leave it empty if the stack runs on this computer.',
            ),
            DeclareLaunchArgument(
                'domain_id',
                default_value=EnvironmentVariable('ROS_DOMAIN_ID', default_value='0'),
                description='The ROS domain, 0 to 101.',
            ),
            Node(
                package='evgp_kart_bridge',
                executable='kart_bridge_node',
                exec_name='kart_bridge_node',
                name='kart_bridge',
                namespace=LaunchConfiguration('namespace'),
                parameters=[
                    LaunchConfiguration('params_file'),
                    {'host': ParameterValue(LaunchConfiguration('host'), value_type=str)},
                ],
                remappings=[('~/odom', LaunchConfiguration('odom'))],
                additional_env={
                    'EVGP_GRAPH_INTERFACE': LaunchConfiguration('graph_interface'),
                    'ROS_DOMAIN_ID': LaunchConfiguration('domain_id'),
                },
                output='screen',
                # A bridge that died restarts in RED_RED, like every bridge (§3.E). Until then, the
                # stack stops because the bridge's topics are silent.
                prefix=PREFIX,
            ),
        ]
    )
