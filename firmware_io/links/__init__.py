# SPDX-License-Identifier: MIT
"""Ways for frames to reach the hardware."""
