# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Build file of the ament_python package evgp_rcs."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'evgp_rcs'

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed', 'report/page.*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/launch', glob('launch/*.launch.py')),
        (f'share/{PACKAGE}/config', glob('config/*')),
    ],
    install_requires=['setuptools'],
    extras_require={
        # By this colcon knows how to run the tests.
        'test': ['pytest'],
        # For `rcs_record mcap` only; rosdep has no key for it.
        'mcap': ['mcap'],
    },
    zip_safe=False,
    maintainer='EVGP race control maintainers',
    maintainer_email='evgp-race-control@users.noreply.github.com',
    author='EVGP race control contributors',
    url='https://engineering.purdue.edu/evGrandPrix/',
    description='The EVGP race control: rules, kart server, record and node for the officials.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'rcs_node = evgp_rcs.node:main',
            'rcs_record = evgp_rcs.rcs_record:main',
            'rcs_roster = evgp_rcs.roster_check:main',
            'rcs_spare = evgp_rcs.spare:main',
            'rcs_takeover = evgp_rcs.takeover:main',
        ],
    },
)
