# SPDX-License-Identifier: MIT
"""The robot's hardware as typed signals: links, drives, health."""
