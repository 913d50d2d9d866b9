# SPDX-License-Identifier: MIT
"""Messages that no wheel has, built from their definitions by the generators that come with the wheels of ROS.

`tf2_msgs` is part of every installation of ROS and is not on PyPI.
"""

import importlib
import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Final

import numpy as np

_TF_MESSAGE: Final = """\
#include "geometry_msgs/msg/TransformStamped.idl"

module tf2_msgs {
  module msg {
    struct TFMessage {
      sequence<geometry_msgs::msg::TransformStamped> transforms;
    };
  };
};
"""
"""As rosidl_adapter makes it of the definition, `geometry_msgs/TransformStamped[] transforms`."""
_KINDS: Final = ("rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c")
_GENERATORS: Final = (
    ("rosidl_generator_c.cli", "GenerateC", None),
    ("rosidl_typesupport_fastrtps_c.cli", "GenerateFastRTPSCTypesupport", None),
    ("rosidl_typesupport_introspection_c.cli", "GenerateIntrospectionCTypesupport", None),
    ("rosidl_typesupport_c.cli", "GenerateCTypesupport", list(_KINDS)),
    ("rosidl_generator_py.cli", "GeneratePython", ["rosidl_typesupport_c"]),
)
_LINKER: Final = ("g++",)
_LIBRARIES: Final = (
    "fastcdr",
    "rosidl_runtime_c",
    "rcutils",
    "rosidl_typesupport_c",
    *_KINDS,
    "rosidl_typesupport_fastrtps_cpp",
    *(
        f"{package}__{part}"
        for package in ("geometry_msgs", "std_msgs", "builtin_interfaces")
        for part in ("rosidl_generator_c", "rosidl_typesupport_c", *_KINDS)
    ),
    "geometry_msgs__rosidl_generator_py",
)


def build_tf2_msgs(folder: Path) -> Path:
    """Build `tf2_msgs` with TFMessage; returns what belongs into PYTHONPATH."""
    definitions, made = folder / "definitions", folder / "made"
    package = made / "tf2_msgs"
    prefix = Path(sys.prefix)
    (definitions / "msg").mkdir(parents=True)
    (definitions / "msg" / "TFMessage.idl").write_text(_TF_MESSAGE, "utf-8")
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)  # by which the generators find their templates
    for module, name, over in _GENERATORS:
        chosen = {} if over is None else {"typesupport_implementations": over}
        generator = getattr(importlib.import_module(module), name)(name, **chosen)
        generator.generate("tf2_msgs", [f"{definitions}:msg/TFMessage.idl"], [str(prefix / "share")], package)
    (package / "__init__.py").touch()
    includes = [
        made,
        prefix / "include",
        *(prefix / "include").iterdir(),
        Path(sysconfig.get_path("include")),
        Path(np.get_include()),
    ]
    options = ["-O0", "-fPIC", "-w", *(f"-I{each}" for each in includes if each.is_dir())]
    objects = []
    for source in sorted([*package.rglob("*.c"), *package.rglob("*.cpp")]):
        compiled = source.with_name(f"{source.name}.o")
        compiler = ["gcc"] if source.suffix == ".c" else [*_LINKER, "-std=c++17"]
        subprocess.run([*compiler, *options, "-c", str(source), "-o", str(compiled)], check=True)
        objects.append(str(compiled))
    libraries = [f"-L{prefix / 'lib'}", f"-Wl,-rpath,{prefix / 'lib'}", *(f"-l{each}" for each in _LIBRARIES)]
    _link(package / "libtf2_msgs.so", *objects, *libraries)
    found = ["-Wl,--no-as-needed", f"-L{package}", "-Wl,-rpath,$ORIGIN"]
    # ROS asks for a library of each kind by its name; that all of them hold is in one.
    for kind in _KINDS:
        _link(package / f"libtf2_msgs__{kind}.so", *found, "-ltf2_msgs")
    extension = package / f"tf2_msgs_s__rosidl_typesupport_c{sysconfig.get_config_var('EXT_SUFFIX')}"
    _link(extension, *found, "-ltf2_msgs", *(f"-ltf2_msgs__{kind}" for kind in _KINDS))
    return made


def _link(library: Path, *words: str) -> None:
    named = f"-Wl,-soname,{library.name}"
    subprocess.run([*_LINKER, "-shared", named, "-o", str(library), *words], check=True)
