# SPDX-License-Identifier: MIT
"""No secret leaves; what helps stays."""

import base64
import hashlib
import json

import pytest

from segway_ecc.deploy.station.web.access import new_access
from segway_ecc.deploy.support.bundle import HIDDEN, environment, hidden

SECRET = "s3cr3t-value"  # noqa: S105 - nobody's
TOKEN = "Zx9-Kq2_Lm7Wp4Rt8Vb3Nc6Yd1H"  # noqa: S105 - nobody's
SHA = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"


@pytest.mark.parametrize(
    "text",
    [
        f"token={SECRET}",
        f"api_token: {SECRET}",
        f"WIFI_PASSWORD={SECRET}",
        f'"password": "{SECRET} and more"',
        f"password = '{SECRET} x'",
        f"passphrase: {SECRET}",
        f"Authorization: Bearer {SECRET}",
        f"Authorization: Basic {SECRET}",
        f"the password is {SECRET}",
        f"PrivateKey = {SECRET}=",
        f"PresharedKey = {SECRET}=",
        f"private_key: {SECRET}",
        f"api-key={SECRET}&x=1",
        f"secret: {SECRET}",
        f"credentials={SECRET}",
        f"Cookie: {SECRET}; b=1",
        f"wpa_psk={SECRET}",
        f"http://ann:{SECRET}@example.org/x",
        f"-----BEGIN PRIVATE KEY-----\n{SECRET}\n-----END PRIVATE KEY-----",
        f"-----BEGIN EC PRIVATE KEY-----\n{SECRET} cut off",
        f"a page asked for {TOKEN} here",
        f"GET /x?k={TOKEN}",
        "  operator  abcdefghijklmnopqrstuvwxyz-",
        "  viewer    abcdefghijklmnopqrstuvwxyz-",
    ],
)
def test_secrets_are_hidden(text: str) -> None:
    clean = hidden(text)
    for secret in (SECRET, TOKEN, "abcdefghijklmnopqrstuvwxyz"):
        assert secret not in clean
    assert HIDDEN in clean


def test_the_stations_own_tokens_are_hidden_as_it_shows_them() -> None:
    for _ in range(300):
        _, tokens = new_access()
        shown = "".join(f"segway-ecc[9]:   {role.value:<8}  {token}\n" for role, token in tokens.items())
        clean = hidden(shown)
        assert not any(token in clean for token in tokens.values())


def test_tokens_made_at_random_are_hidden_wherever_they_stand() -> None:
    for number in range(300):
        key = hashlib.sha256(str(number).encode()).digest()
        for token in (base64.urlsafe_b64encode(key).decode().rstrip("="), base64.b64encode(key).decode()):
            assert token not in hidden(f"it said {token} and ended")


@pytest.mark.parametrize(
    "text",
    [
        "2026-11-20T12:00:00.123456+0000 robot segway-ecc[123]: FAULT: the left drive fell silent",
        "the base station is lost; no token was needed",
        f"model sha256 {SHA}",
        "/opt/ros/jazzy/lib/python3.12/site-packages/rclpy/__init__.py",
        "/home/Ann/.local/state/segway-ecc/logs/cart-20261120T120000Z-4711.mcap",
        "segway_ecc.node.models.segway:SegwayVoltageController",
        "NobodyListensError: no robot was found within 5 s",
        "set_point_timeout_of_the_robot_2: 1.0",
        "keyboard: us",
        "    mtu 1500 qdisc noqueue state UP mode DEFAULT group default qlen 1000",
        "authors: Ann",
    ],
)
def test_what_helps_stays(text: str) -> None:
    assert hidden(text) == text


def test_json_stays_json() -> None:
    text = json.dumps({"token": "abc", "n": [1, {"password": "x y"}]})
    assert json.loads(hidden(text)) == {"token": HIDDEN, "n": [1, {"password": HIDDEN}]}


def test_of_the_environment_only_what_concerns_us_and_no_secret() -> None:
    variables = {
        "ROS_DOMAIN_ID": "7",
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_SECURITY_KEYSTORE": "/keys",
        "ROS_TOKEN": "abc",
        "PATH": "/bin",
        "AWS_REGION": "x",
        "GITHUB_TOKEN": "abc",
        "HOME_WIFI_PASSWORD": "abc",
        "ROS_STATIC_PEERS": f"http://a:{SECRET}@b",
    }
    assert environment(variables) == {
        "PATH": "/bin",
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_DOMAIN_ID": "7",
        "ROS_STATIC_PEERS": f"http://a:{HIDDEN}@b",
    }
