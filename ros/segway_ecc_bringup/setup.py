# SPDX-License-Identifier: MIT
"""The package as colcon builds it: files alone; the program is that of `pip install segway-ecc`."""

from pathlib import Path

from setuptools import setup

NAME = "segway_ecc_bringup"
SHARE = f"share/{NAME}"

setup(
    name=NAME,
    version="0.1.0",
    packages=[],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (SHARE, ["package.xml"]),
        *(
            (f"{SHARE}/{folder}", sorted(map(str, Path(folder).iterdir())))
            for folder in ("launch", "config", "layouts")
        ),
    ],
    zip_safe=True,
    maintainer="the segway-ecc project",
    maintainer_email="segway-ecc@example.org",
    description="Launch files, parameters, layouts and example configurations for robots that segway-ecc runs.",
    license="MIT",
)
