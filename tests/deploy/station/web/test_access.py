# SPDX-License-Identifier: MIT
import hashlib
import json
import stat
from pathlib import Path

import pytest

from segway_ecc.deploy.station.web.access import Role, load_access, new_access
from segway_ecc.node.errors import ConfigurationError


def test_token_maps_to_its_role() -> None:
    access, tokens = new_access()
    assert {role: access.role(token) for role, token in tokens.items()} == {role: role for role in Role}
    for wrong in ("", "x", tokens[Role.VIEWER][:-1], tokens[Role.VIEWER] + "x", "é\ud800", "x" * 10_000_000):
        assert access.role(wrong) is None


def test_tokens_are_long_and_never_the_same() -> None:
    tokens = [token for _ in range(20) for token in new_access()[1].values()]
    assert len(set(tokens)) == 40
    assert all(len(token) >= 27 for token in tokens)  # 20 bytes in base64


def test_only_salted_hashes_are_kept_and_only_for_the_owner(tmp_path: Path) -> None:
    access, tokens = new_access()
    path = tmp_path / "station" / "access.json"
    access.save(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    text = path.read_text()
    assert not any(token in text for token in tokens.values())
    kept = json.loads(text)
    salt = bytes.fromhex(kept["salt"])
    assert len(salt) >= 16
    for role, token in tokens.items():
        assert kept["hashes"][role] == hashlib.sha256(salt + token.encode()).hexdigest()
    again = load_access(path)
    assert again is not None
    assert again.role(tokens[Role.OPERATOR]) is Role.OPERATOR


def test_a_file_that_others_can_read_is_closed_to_them(tmp_path: Path) -> None:
    path = tmp_path / "access.json"
    new_access()[0].save(path)
    path.chmod(0o644)
    load_access(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_new_tokens_make_the_old_ones_worthless(tmp_path: Path) -> None:
    path = tmp_path / "access.json"
    first, tokens = new_access()
    first.save(path)
    new_access()[0].save(path)
    access = load_access(path)
    assert access is not None
    assert access.role(tokens[Role.OPERATOR]) is None
    assert [file.name for file in tmp_path.iterdir()] == ["access.json"]


def test_missing_token_file_returns_none(tmp_path: Path) -> None:
    assert load_access(tmp_path / "access.json") is None


@pytest.mark.parametrize(
    "content", ["", "{}", "[]", '{"salt": "zz", "hashes": {}}', '{"salt": "00", "hashes": {"viewer": "00"}}', "\xff"]
)
def test_damaged_token_file_raises_with_fix(tmp_path: Path, content: str) -> None:
    path = tmp_path / "access.json"
    path.write_text(content, encoding="latin-1")
    with pytest.raises(ConfigurationError, match="--new-tokens"):
        load_access(path)


def test_unreadable_or_unwritable_token_file_raises(tmp_path: Path) -> None:
    (tmp_path / "access.json").mkdir()
    with pytest.raises(ConfigurationError, match="cannot be read"):
        load_access(tmp_path / "access.json")
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match="cannot be kept"):
        new_access()[0].save(tmp_path / "file" / "access.json")
