# SPDX-License-Identifier: MIT
"""The first hours with a robot: what a person is told, what is measured, and the report that arming asks for."""
