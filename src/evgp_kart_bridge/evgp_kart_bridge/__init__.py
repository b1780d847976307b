# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The kart's side of the EVGP race control: tells the stack the state to obey."""
