# SPDX-License-Identifier: MIT
"""Kernels to run hardware-in-the-loop tests in, where the host's own kernel has no SocketCAN."""
