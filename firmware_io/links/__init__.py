"""Ways for frames to reach the hardware."""
