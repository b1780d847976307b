# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Build file of the ament_python package evgp_rcs_console."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'evgp_rcs_console'

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', glob('config/*')),
        (f'share/{PACKAGE}/launch', glob('launch/*.launch.py')),
    ],
    install_requires=['setuptools'],
    # By this colcon knows how to run the tests.
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='EVGP race control maintainers',
    maintainer_email='evgp-race-control@users.noreply.github.com',
    author='EVGP race control contributors',
    url='https://engineering.purdue.edu/evGrandPrix/',
    description="The officials' console of the EVGP race control: a window and a terminal client.",
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'rcs_button = evgp_rcs_console.button:main',
            'rcs_ctl = evgp_rcs_console.ctl:main',
            'rcs_gui = evgp_rcs_console.gui:main',
        ],
    },
)
