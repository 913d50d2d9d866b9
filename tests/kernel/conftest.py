import os

# The files in guest/ need SocketCAN: test_in_guest.py runs them in a kernel that has it, and sets this variable there.
collect_ignore = [] if "SEGWAY_ECC_IN_GUEST" in os.environ else ["guest"]
