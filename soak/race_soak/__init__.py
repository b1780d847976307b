# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""A soak of race control: many karts, faults, acks and commands, held against its record."""
