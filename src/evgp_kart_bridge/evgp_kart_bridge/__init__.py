# Copyright 2026 EVGP race control contributors
# SPDX-License-Identifier: Apache-2.0

"""The kart's side of EVGP race control. It publishes the state that the kart must obey."""
