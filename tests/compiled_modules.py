# SPDX-License-Identifier: MIT
"""Which modules a compiled wheel compiles, as pyproject.toml lists them."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WHEEL = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
HOOK = WHEEL["hooks"]["mypyc"]
COMPILED = [name.removeprefix("/") for name in HOOK["include"]]
