# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Build file of the package my_kart: each executable has a line in `console_scripts`."""

from setuptools import setup

setup(
    name='my_kart',
    version='0.1.0',
    packages=['my_kart'],
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/my_kart']),
        ('share/my_kart', ['package.xml']),
    ],
    entry_points={'console_scripts': ['stack = my_kart.stack:main']},
)
