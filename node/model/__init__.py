# SPDX-License-Identifier: MIT
"""The model runtime: sections, integration methods, named variables."""
