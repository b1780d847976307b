# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Build file of evgp_protocol, an ament_python package and one for pip alone."""

import pathlib

from setuptools import find_packages, setup

PACKAGE = 'evgp_protocol'
# Where colcon builds, setup.py is a link and has no neighbours.
README = pathlib.Path(__file__).resolve().with_name('README.md')

setup(
    name=PACKAGE,
    version='0.1.0',
    packages=find_packages(exclude=['test']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
    ],
    python_requires='>=3.10',
    # By this colcon knows how to run the tests.
    extras_require={'test': ['pytest']},
    zip_safe=False,
    maintainer='EVGP race control maintainers',
    maintainer_email='evgp-race-control@users.noreply.github.com',
    author='EVGP race control contributors',
    url='https://engineering.purdue.edu/evGrandPrix/',
    description='What goes over the wire between the EVGP race control and a kart; needs no ROS.',
    long_description=README.read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    license_files=['LICENSE'],
    classifiers=['Programming Language :: Python :: 3', 'Typing :: Typed'],
)
