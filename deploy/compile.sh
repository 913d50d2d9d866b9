#!/bin/sh
# SPDX-License-Identifier: MIT
# Installs this checkout, compiled, into an environment that has what it needs: deploy/compile.sh ENVIRONMENT
# It is built in build/compiled, from a copy of the sources, since the build leaves its results among them.
set -eu

fail() {
    echo "compile: $1" >&2
    exit 1
}

[ $# = 1 ] || fail "deploy/compile.sh ENVIRONMENT: one that has what is needed, such as deploy/setup.sh makes"
[ -x "$1/bin/python" ] || fail "there is no environment $1; make one: deploy/setup.sh $1"
command -v cc > /dev/null || fail "no C compiler: sudo apt-get install gcc python3-dev"
python=$(realpath "$1")/bin/python
cd "$(dirname "$0")/.."
folder=$PWD/build/compiled
rm -rf "$folder"
mkdir -p "$folder/source"
git ls-files -z --cached --others --exclude-standard -- pyproject.toml README.md LICENSE* segway_ecc firmware_io node hil deploy |
    xargs -0 cp --no-dereference --parents -t "$folder/source"

# At a place that stays: what is counted is known again by the paths of what is compiled, and pip's own would be new each time.
"$python" -c '
import tomllib
build = tomllib.load(open("pyproject.toml", "rb"))
hook = build["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["mypyc"]
print(*build["build-system"]["requires"], *hook["dependencies"], "setuptools", sep="\n")
' > "$folder/tools.txt"
"$python" -P -m pip install --quiet --disable-pip-version-check --target "$folder/tools" --requirement "$folder/tools.txt"

build() {
    find "$folder/source" -name '*.so' -delete
    rm -rf "$folder/objects"
    mkdir "$folder/objects"
    # Hidden, functions call each other directly and not through tables. Unfused, arm64 rounds as x86-64 and as Python do.
    CFLAGS="-ffp-contract=off -fvisibility=hidden -fno-plt $1" PYTHONPATH="$folder/tools" HATCH_MYPYC_BUILD_DIR="$folder/objects" \
        HATCH_BUILD_HOOKS_ENABLE=1 "$python" -P -m pip install --quiet --disable-pip-version-check --no-deps \
        --no-build-isolation --force-reinstall "$folder/source"
}

# Built twice: the first build counts what runs often, by which the second keeps that together and makes the rest small, so
# that less has to be fetched by a loop that finds its caches cold.
echo "compile: the first build, which counts" >&2
build "-fprofile-generate -fprofile-update=atomic -fprofile-dir=$folder/counted"
echo "compile: robots run, and are counted" >&2
(
    cd "$folder" # where no sources are
    "$python" -P -m segway_ecc.node.cli.main bench --only loops lock-step --programs ours > /dev/null
)
echo "compile: the second build" >&2
build "-fprofile-use=$folder/counted -fprofile-correction -Wno-missing-profile"
