"""What takes the robot's software onto a robot."""
