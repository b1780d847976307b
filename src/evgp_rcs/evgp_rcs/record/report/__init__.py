# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The report of a run: one HTML page, for a jury that knows nothing about software."""
