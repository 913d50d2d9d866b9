# SPDX-License-Identifier: MIT
"""Models that ship with the package."""
