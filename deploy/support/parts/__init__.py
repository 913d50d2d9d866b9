# SPDX-License-Identifier: MIT
"""The parts of a support bundle, each of which may fail on its own."""
