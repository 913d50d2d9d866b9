"""The health of the robot as standard diagnostics."""
