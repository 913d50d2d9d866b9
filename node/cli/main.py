# SPDX-License-Identifier: MIT
"""From a control model that works on the bench to the software of a real robot.

Data on standard output, messages on standard error. Exit codes: 0 done; 1 another error of ours, or an output
that is full; 2 arguments, robot file or sequence file; 3 model; 4 hardware; 5 ROS 2 missing; 6 no model node found;
7 robot lost; 8 simulation; 9 log; 10 a robot in FAULT; 11 update refused; 12 version not healthy; 13 sequence refused
or not received whole; 14 a run failed although repeated; 130 Ctrl-C.
"""

if __name__ == "__main__":  # with `python -m` as the command: before the imports
    from segway_ecc.node.cli.first import end_by_interrupt, run_imported

    is_ours = end_by_interrupt()

import argparse
import contextlib
import difflib
import importlib
import math
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Any, Final, NoReturn

from segway_ecc.firmware_io.errors import PluginError, SegwayEccError
from segway_ecc.firmware_io.plugins import entry_points, import_plugin
from segway_ecc.node.cli.interrupts import ends_at_once
from segway_ecc.node.cli.streams import OutputError, claim_streams, flush_output
from segway_ecc.node.cli.verb import ENTRY_POINTS, Section, Verb
from segway_ecc.node.errors import ConfigurationError, plain_number, printable, whole_number

_PROGRAM: Final = "segway-ecc"
_INTERRUPTED: Final = 130
_ENDS_WITHIN_S: Final = 5.0
_OPENSSL: Final = "_hashlib"
"""Where `hashlib` finds OpenSSL: 3.5 MB for some digests that Python has too, and uses where this is missing."""
_PARAGRAPH: Final = "\n\n"
_FIRST_STEPS: Final = """Try first:
  segway-ecc case-study            the thesis' tables and figures in each execution environment
  segway-ecc demo                  a simulated robot in the browser, to see, push and break
  segway-ecc model inspect FOLDER  your own model: ports, parameters and states
All verbs: segway-ecc --help
"""
_FOOT: Final = f"""{_PROGRAM} VERB --help shows the options of a verb, or the verbs of a group.

options:
  --version             show the version and exit
  --completion SHELL    print the completion script of bash, zsh or fish and exit
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb and return its exit code; without arguments those of this process, whose streams become ours."""
    if arguments is None:
        with ends_at_once():
            claim_streams()
            _claim_signals()
    code = _run(arguments)
    if arguments is None:
        _end_for_sure(code)
    try:
        flush_output()
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:  # the reader of our output has closed it
        return code
    except OutputError as error:
        if not code:  # else the verb's own line is there already
            sys.stderr.write(f"{_PROGRAM}: {error}\n")
            return error.exit_code
    return code


def _claim_signals() -> None:
    """Undo what this process may have inherited: SIGCHLD tells how a helper ended, and SIGTERM must come through."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_SETMASK, ())


def _end_for_sure(code: int) -> None:
    """End this process with `code` where a thread that a model has left, or what it does at exit, never returns."""

    def end() -> None:
        time.sleep(_ENDS_WITHIN_S)
        sys.stderr.write(
            f"{_PROGRAM}: a thread, or what a model does at exit, went on for {_ENDS_WITHIN_S:g} s: ended\n"
        )
        os._exit(code)

    threading.Thread(target=end, daemon=True).start()


def _run(arguments: Sequence[str] | None) -> int:
    try:
        with ends_at_once():
            words, ros_arguments = list(sys.argv[1:] if arguments is None else arguments), []
            if "--ros-args" in words:  # from there on it is meant for ROS
                at = words.index("--ros-args")
                words, ros_arguments = words[:at], words[at:]
            for word in words:
                if word != printable(word):
                    raise ConfigurationError(f"an argument is not UTF-8 text: '{word}'; rename the file")
            if not words:
                sys.stderr.write(_FIRST_STEPS)
                return ConfigurationError.exit_code
            if words[0] == "run":
                sys.modules.setdefault(_OPENSSL, None)  # type: ignore[arg-type]  # None: not available
            options = command_line(find_verbs(), words).parse_args(words)
            options.ros_arguments = ros_arguments
        options.output = sys.stdout
        # What a model in Python prints would not be JSON either.
        with contextlib.redirect_stdout(sys.stderr) if vars(options).get("json") else contextlib.nullcontext():
            return int(options.function(options))
    except SegwayEccError as error:
        sys.stderr.write(f"{_PROGRAM}: {error}\n")
        return error.exit_code
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:
        return 0
    except SystemExit as ended:  # of the parser
        return int(ended.code or 0)


def find_verbs() -> dict[str, Verb]:
    """The verbs of every room and of other distributions by name."""
    verbs: dict[str, Verb] = {}
    for point in sorted(entry_points(ENTRY_POINTS), key=lambda point: point.value, reverse=True):
        try:
            loaded: Any = import_plugin(point, "the package of verbs")
        except PluginError as error:  # the verbs of the others work without
            sys.stderr.write(f"{_PROGRAM}: {error}\n")
        else:
            verbs |= {verb.name: verb for verb in loaded}
    return verbs


def command_line(verbs: Mapping[str, Verb], words: Sequence[str] | None = None) -> argparse.ArgumentParser:
    """The parser of the whole command line, of the verbs by name.

    Only the verb that the words name is imported, so that a robot starts without what the others need. None imports
    all, as shell completion needs.

    Raises:
        ConfigurationError: The words name no verb.
    """
    chosen = None if words is None else _chosen(verbs, words)
    parser = _TopParser(verbs)
    groups = {"": parser.add_subparsers(dest="verb", metavar="VERB", required=True, parser_class=_Parser)}
    for verb in sorted(verbs.values(), key=lambda verb: verb.package is not None):
        group, _, last = verb.name.rpartition(" ")
        text = f"{verb.summary[0].upper()}{verb.summary[1:]}."
        added = groups[group].add_parser(last, help=verb.summary, description=text, epilog=f"Example: {verb.example}")
        if verb.package is None:
            groups[verb.name] = added.add_subparsers(dest="task", metavar="VERB", required=True)
        elif chosen in {None, verb.name}:
            module = importlib.import_module(verb.module)
            module.add_arguments(added)
            added.epilog = f"{(module.__doc__ or '').partition(_PARAGRAPH)[2]} {added.epilog}"
            added.set_defaults(function=module.run)
    return parser


def _chosen(verbs: Mapping[str, Verb], words: Sequence[str]) -> str:
    """The verb that the words name, or its group where they name no more; nothing where they begin with an option."""
    first, *others = words
    if first.startswith("-"):
        return ""
    is_group = first in verbs and verbs[first].package is None
    name = f"{first} {others[0]}" if is_group and others and not others[0].startswith("-") else first
    if name in verbs:
        return name
    formerly = {verb.formerly: verb.name for verb in verbs.values() if verb.formerly}
    by_last_word = {verb.rpartition(" ")[2]: verb for verb in verbs}
    close = (
        [formerly[typed] for typed in (" ".join(words[:2]), first) if typed in formerly]
        or difflib.get_close_matches(name, verbs, 1)
        or [by_last_word[word] for word in difflib.get_close_matches(name.rpartition(" ")[2], by_last_word, 1)]
    )
    hint = f"did you mean '{_PROGRAM} {close[0]}'? See" if close else "see"
    raise ConfigurationError(f"there is no verb '{name}'; {hint} {_PROGRAM} --help")


class _Parser(argparse.ArgumentParser):
    """Reports an error in one line, and accepts a number such as -1e-3 as a number."""

    def __init__(self, **settings: Any) -> None:  # noqa: ANN401 - argparse's own settings, handed on
        super().__init__(**settings)
        self.register("type", float, _finite)
        self.register("type", int, whole_number)
        # Before Python 3.14 argparse takes what has an exponent, or is infinite, for an option.
        self._negative_number_matcher = re.compile(r"^-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$|^-(inf|nan)$")

    def error(self, message: str) -> NoReturn:
        """End with one line and the exit code for arguments."""
        self.exit(ConfigurationError.exit_code, f"{_PROGRAM}: {message}; see {self.prog} --help\n")


def _finite(text: str) -> float:
    value = plain_number(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not finite")
    return value


class _TopParser(_Parser):
    """Shows the verbs by section, each with an example."""

    def __init__(self, verbs: Mapping[str, Verb]) -> None:
        super().__init__(prog=_PROGRAM)
        self._verbs = verbs
        self.add_argument("--version", action=_Version, nargs=0)
        self.add_argument("--completion", action=_Completion, choices=("bash", "zsh", "fish"))

    def format_help(self) -> str:
        lines = [f"usage: {_PROGRAM} VERB ...", "", __doc__.partition("\n")[0], ""]
        for section in Section:
            lines.append(f"{section.value}:")
            verbs = [verb for verb in self._verbs.values() if verb.section is section]
            lines += [f"  {verb.name:<11} {verb.summary:<69} {verb.example}" for verb in verbs]
            lines.append("")
        return "\n".join([*lines, _FOOT])


class _Version(argparse.Action):
    """Looks for the version where it is asked for: that takes longer than all the rest of reading the command line."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        metadata = importlib.import_module("importlib.metadata")
        sys.stdout.write(f"{metadata.version(_PROGRAM)}\n")
        parser.exit()


class _Completion(argparse.Action):
    """Prints the completion script of a shell, which names every verb and option; shtab writes it."""

    def __call__(
        self, parser: argparse.ArgumentParser, _namespace: argparse.Namespace, shell: object, *_: object
    ) -> None:
        try:
            shtab = importlib.import_module("shtab")
        except ModuleNotFoundError as error:
            raise ConfigurationError("completion needs shtab: pip install 'segway-ecc[completion]'") from error
        sys.stdout.write(shtab.complete(command_line(find_verbs()), shell=shell) + "\n")
        parser.exit()


if __name__ == "__main__":
    sys.exit(run_imported(main, is_ours=is_ours))
