# SPDX-License-Identifier: MIT
"""The guard: disables the drives when the node's heartbeats stop, whatever became of it."""
