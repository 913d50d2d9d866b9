# SPDX-License-Identifier: MIT
"""The base station: what is known of the robots, who may command them, and the page that shows it."""
