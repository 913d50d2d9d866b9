# SPDX-License-Identifier: MIT
"""What the verbs that serve the base station and install it share."""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.web.access import Role

PLAIN_HTTP: Final = "plain HTTP: whoever is on this network can read the token and use it; give --certificate and --key"


def add_listening(parser: argparse.ArgumentParser) -> None:
    """By which names the page is served, with which certificate, and whether tokens are made anew."""
    option = parser.add_argument
    option("--host", action="append", default=[], metavar="NAME", help="another name by which browsers find us")
    option("--certificate", type=Path, metavar="FILE", help="certificate chain for TLS, PEM")
    option("--key", type=Path, metavar="FILE", help="its private key, where it is not in the same file")
    option("--new-tokens", action="store_true", help="make new tokens; the old ones are good for nothing any more")


def show_tokens(tokens: Mapping[Role, str]) -> None:
    """Print new tokens, at once, since they hold whatever fails next; never through the messages, which may be kept."""
    rows = "".join(f"  {role.value:<8}  {token}\n" for role, token in tokens.items())
    sys.stderr.write(f"segway-ecc: new tokens, shown this once; keep them:\n{rows}")
    sys.stderr.flush()
