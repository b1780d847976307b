# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Build file of evgp_protocol, an ament_python package and one for pip alone: see setup.cfg."""

from setuptools import setup

setup()
