# SPDX-License-Identifier: MIT
"""Studies in lock step: what comes of a choice over a whole grid of conditions."""
