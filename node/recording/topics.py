"""Names of topics, in the log and in ROS alike."""

import re


def topic(group: str, name: str) -> str:
    """A valid ROS topic name: the name's hierarchy with `/`, and anything that ROS does not take as `_`."""
    hierarchy = re.sub(r"[.\\]", "/", name)
    return f"/{group}/{re.sub(r'[^A-Za-z0-9_/]', '_', hierarchy)}"
