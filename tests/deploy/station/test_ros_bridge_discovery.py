# SPDX-License-Identifier: MIT
from segway_ecc.deploy.station.ros_bridge import MODE_TYPE, robots_in, topic


def test_a_robot_is_a_mode_of_the_right_type() -> None:
    topics = [
        ("/zoe/mode", [MODE_TYPE]),
        ("/mode", ["std_msgs/msg/String", MODE_TYPE]),
        ("/lab/amy/mode", [MODE_TYPE]),
        ("/bob/mode", ["std_msgs/msg/String"]),
        ("/eve/commode", [MODE_TYPE]),
        ("/eve/mode/other", [MODE_TYPE]),
    ]
    assert robots_in(topics) == ["/", "/lab/amy", "/zoe"]


def test_topics_of_a_robot() -> None:
    assert topic("/", "odom") == "/odom"
    assert topic("/lab/amy", "set/stand") == "/lab/amy/set/stand"
