# SPDX-License-Identifier: MIT
"""Recorded logs, read for the page that plays them."""
