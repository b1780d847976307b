# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Sources of passings: what timing devices say of karts that cross the line."""
