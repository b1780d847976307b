# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Build file of the ament_python package evgp_kart_bridge."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'evgp_kart_bridge'

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/launch', glob('launch/*.launch.py')),
        (f'share/{PACKAGE}/config', glob('config/*.yaml')),
    ],
    install_requires=['setuptools'],
    # By this colcon knows how to run the tests.
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='EVGP race control maintainers',
    maintainer_email='evgp-race-control@users.noreply.github.com',
    author='EVGP race control contributors',
    url='https://engineering.purdue.edu/evGrandPrix/',
    description="The kart's side of the EVGP race control: tells the stack the state to obey.",
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'kart_bridge_node = evgp_kart_bridge.node:main',
            'autoware_adapter = evgp_kart_bridge.autoware_adapter:main',
            'example_stack = evgp_kart_bridge.example_stack:main',
            'plain_driver = evgp_kart_bridge.plain_driver:main',
            'shortest_stack = evgp_kart_bridge.shortest_stack:main',
        ],
    },
)
