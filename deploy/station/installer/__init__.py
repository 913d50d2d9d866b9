# SPDX-License-Identifier: MIT
"""A machine as a base station: its service, tokens, discovery settings and firewall."""
