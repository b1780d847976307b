# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Build file of the ament_python package evgp_node."""

from setuptools import find_packages, setup

PACKAGE = 'evgp_node'

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
    ],
    install_requires=['setuptools'],
    # By this colcon knows how to run the tests.
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='EVGP race control maintainers',
    maintainer_email='evgp-race-control@users.noreply.github.com',
    author='EVGP race control contributors',
    url='https://engineering.purdue.edu/evGrandPrix/',
    description='What the nodes of the EVGP race control share as ROS processes.',
    license='Apache-2.0',
)
