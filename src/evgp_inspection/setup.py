# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Build file of the ament_python package evgp_inspection."""

from setuptools import find_packages, setup

PACKAGE = 'evgp_inspection'

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
    description='Inspects whether a kart, or a race control, is fit to race; needs no ROS.',
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'inspect_kart = evgp_inspection.cli:inspect_kart',
            'inspect_rcs = evgp_inspection.cli:inspect_rcs',
            'survey_network = evgp_inspection.survey_network:survey_network',
        ],
    },
)
