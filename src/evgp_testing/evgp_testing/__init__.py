# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""
The parts of a race, for tests and the demonstration: all real, none a mock.

With the workspace sourced, pytest finds the fixtures of ``evgp_testing.fixtures`` by itself, in a
team's own tests too.
Each part owns its process or its context, executor and domain, and gives everything back
in ``close``; each can be used in a ``with`` statement.
"""
