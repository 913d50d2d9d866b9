"""Simulated devices; each bears the name of the drive family it stands in for."""
