# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Build file of the ament_python package evgp_rehearsal: see setup.cfg."""

from setuptools import setup

setup()
