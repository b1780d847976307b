# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The EVGP race control: rules, kart server, record and node for the officials."""
