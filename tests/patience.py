# SPDX-License-Identifier: MIT
"""How long tests wait for what must come."""

PATIENCE_S = 300.0
"""Only what hangs takes as long: with forty programs on two processors everything takes twenty times as long."""
