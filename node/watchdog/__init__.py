# SPDX-License-Identifier: MIT
"""Watches the calls into a model from a process of its own, and reports one that never returns or ends the process."""
