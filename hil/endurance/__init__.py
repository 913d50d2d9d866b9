"""Hours of normal driving in lock step, with lost frames."""
