# SPDX-License-Identifier: MIT
"""Models that arrive as FMUs: unpacked, described, and driven through a shim of ours."""
