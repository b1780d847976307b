# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The parts of a race, for tests and the demonstration. All of them are real, and none is a mock.

With the workspace sourced, pytest finds the fixtures of ``evgp_testing.fixtures`` automatically,
even for a team's own tests. Each part owns its process, or its context, executor and domain. It
releases everything in ``close``, and can be used in a ``with`` statement.
"""
