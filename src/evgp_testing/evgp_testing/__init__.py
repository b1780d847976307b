# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The parts of a race, for tests and the demonstration: all real, none a mock.

With the workspace sourced, pytest finds the fixtures of ``evgp_testing.fixtures`` automatically,
even for a team's own tests. Each part owns its process, or its context, executor and domain, and
releases everything in ``close``. Each can be used in a ``with`` statement.
"""
