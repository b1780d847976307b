# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The officials' console of the EVGP race control: a window and a terminal client."""
