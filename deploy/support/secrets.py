# SPDX-License-Identifier: MIT
"""Keeps secrets out of what is handed to others: by their names, and by what tokens and keys look like."""

import itertools
import re
from collections.abc import Mapping
from typing import Final

HIDDEN: Final = "[hidden]"
_KEPT_VARIABLES: Final = re.compile(
    r"(ROS|RMW|RCUTILS|RCL|FASTRTPS|FASTDDS|CYCLONEDDS|AMENT|COLCON|PYTHON|LC|XDG|SEGWAY_ECC)_\w*"
    r"|LANG|PATH|PYTHONPATH|LD_LIBRARY_PATH|VIRTUAL_ENV|TZ|TERM|SHELL|CYCLONEDDS_URI|INVOCATION_ID"
)
_WORDS_FOR_IT: Final = (
    r"(?:token|secret|passw(?:or)?d|passphrase|passwd|pwd|credentials?|cookie|authori[sz]ation|bearer"
    r"|(?:api|access|private|preshared|pre_shared|secret|signing|encryption)[ _-]?key|psk|auth)"
)
_NAMED: Final = re.compile(
    rf"(?i)(?<![a-z])((?:[\w.-]{{0,40}}[_.-])?{_WORDS_FOR_IT}s?(?:[_-][\w-]{{0,40}})?[\"']?\s*(?:[=:]|\s(?=(?:is|bearer|basic)\s))\s*)"
    r"(?:(?:is|bearer|basic)\s+)?(\"[^\"\n]*\"|'[^'\n]*'|[^\s,;&\"']+)"
)
_SECRET_NAME: Final = re.compile(r"(?i)token|secret|passw|passphrase|pwd|credential|cookie|auth|key|psk|private")
_IN_URL: Final = re.compile(r"(?<=://)([^\s/:@]*):([^\s/@]+)(?=@)")
_PEM: Final = re.compile(r"-----BEGIN [^-\n]*-----.*?(?:-----END [^-\n]*-----|\Z)", re.DOTALL)
_WORD: Final = re.compile(r"(?<![\w+/-])[\w+/-]{20,}={0,2}(?![\w+/=-])", re.ASCII)
_ROLE: Final = re.compile(r"\b((?:operator|viewer)\s{2,})\S{16,}")
"""The base station's tokens, as it shows them at its first start; a journal keeps that."""
_RANDOM: Final = (re.compile(r"[0-9]"), re.compile(r"[a-z]"), re.compile(r"[A-Z]"))
_CASES: Final = _RANDOM[1:]
_OFTEN: Final = 0.36
"""Changes between capitals, small letters, digits and the rest, for each letter: 0.65 in a token, 0.3 in a path."""


def hidden(text: str) -> str:
    """A text without secrets: what is named as one, what is in a URL, PEM, and words that look made at random."""

    def without_value(found: re.Match[str]) -> str:
        # What names the secret, and nothing of it; quotes stay, so that JSON stays JSON.
        quote = found[2][0] if found[2][0] in "\"'" else ""
        return f"{found[1]}{quote}{HIDDEN}{quote}"

    text = _PEM.sub(HIDDEN, text)
    text = _IN_URL.sub(rf"\1:{HIDDEN}", text)
    text = _ROLE.sub(rf"\1{HIDDEN}", text)
    text = _NAMED.sub(without_value, text)
    return _WORD.sub(lambda found: HIDDEN if _is_random(found[0]) else found[0], text)


def environment(variables: Mapping[str, str]) -> dict[str, str]:
    """Of the environment what concerns us, without what looks like a secret."""
    return {
        name: hidden(text)
        for name, text in sorted(variables.items())
        if _KEPT_VARIABLES.fullmatch(name) and not _SECRET_NAME.search(name)
    }


def _is_random(word: str) -> bool:
    """Whether a long word is a token or a key, and no path, name or hash (which has small letters only)."""
    if not all(kind.search(word) for kind in _CASES):
        return False
    # How often it goes from one kind of letter to another.
    kinds = [next((n for n, kind in enumerate(_RANDOM) if kind.match(letter)), -1) for letter in word]
    return sum(one != other for one, other in itertools.pairwise(kinds)) >= _OFTEN * len(word)
