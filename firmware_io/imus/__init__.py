"""Inertial measurement units, one folder each."""
