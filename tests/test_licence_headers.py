# SPDX-License-Identifier: MIT
"""Every source file of ours begins with its licence."""

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HEADER = "SPDX-License-Identifier: MIT"
FORMS = {".py": f"# {HEADER}", ".sh": f"# {HEADER}", ".js": f"// {HEADER}"} | dict.fromkeys(
    (".c", ".h"), f"/* {HEADER} */"
)
NOT_OURS = ("deploy/station/page/vendor/", "tests/vendor/", "hil/bench/controller/", "node/models/cart_submodel/")
"""What others wrote, and what 20-sim generated."""
ALSO = (".ci/run", "deploy/image/files/init", "deploy/image/files/segway-ecc-configure")


def sources() -> list[Path]:
    words = [shutil.which("git") or "git", "ls-files", "-co", "--exclude-standard"]
    names = subprocess.check_output(words, cwd=ROOT, text=True).splitlines()
    ours = [name for name in names if not name.startswith(NOT_OURS) and (Path(name).suffix in FORMS or name in ALSO)]
    return [ROOT / name for name in ours if (ROOT / name).is_file()]


def begins_with_its_licence(path: Path) -> bool:
    first, _, rest = path.read_text("utf-8").partition("\n")
    line = rest.partition("\n")[0] if first.startswith("#!") else first
    return line == FORMS.get(path.suffix, FORMS[".sh"])


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="the files of a checkout are known by git")
def test_every_source_file_of_ours_begins_with_its_licence() -> None:
    found = sources()

    assert len(found) > 800
    assert [str(path.relative_to(ROOT)) for path in found if not begins_with_its_licence(path)] == []
