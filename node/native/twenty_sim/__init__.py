# SPDX-License-Identifier: MIT
"""Models that arrive as code that 20-sim generated: read, described, compiled with a shim of ours."""
