# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""Web pages that show the race to spectators and pit walls, and cannot reach race control."""
