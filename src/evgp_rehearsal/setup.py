# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Build file of the ament_python package evgp_rehearsal."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = 'evgp_rehearsal'

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed', 'page.html']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
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
    description='A race with simulated karts and incidents, to train officials and to try karts.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'demo = evgp_rehearsal.demo:main',
            'rehearse = evgp_rehearsal.rehearse:main',
            'rehearse_kart = evgp_rehearsal.rehearse_kart:main',
        ],
    },
)
