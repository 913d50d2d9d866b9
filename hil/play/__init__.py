# SPDX-License-Identifier: MIT
"""The whole robot on one machine, for a person to drive with the arrow keys."""
