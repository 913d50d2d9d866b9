# SPDX-License-Identifier: MIT
"""Images for the robot: a root file system from Debian packages and our release, and disks made of it."""
