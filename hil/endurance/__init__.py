# SPDX-License-Identifier: MIT
"""Hours of normal driving in lock step, with lost frames."""
