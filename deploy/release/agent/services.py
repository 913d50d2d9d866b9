# SPDX-License-Identifier: MIT
"""The robot's services as systemd shows them, and whether a node that was just restarted is healthy."""

import json
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from segway_ecc.deploy.release.agent.files import AgentRefusedError

NODE: Final = "segway-ecc-node.service"
UNITS: Final = (NODE, "segway-ecc-guard.service", "segway-ecc-archive.service")
ARMED: Final = ("ARMED", "HOLD")
_PROPERTIES: Final = "LoadState,ActiveState,SubState,NRestarts,MainPID,StatusText"
_COMMAND_S: Final = 100.0
_POSTURE: Final = frozenset({"imu_still", "tilt", "wheels_still"})
"""Pre-arm checks of how the robot stands, not of how well its software runs."""
_RATE_TOLERANCE: Final = 0.01


@dataclass(frozen=True, slots=True)
class Service:
    """A unit as systemd shows it.

    Attributes:
        load: `loaded` where it is installed.
        active: `active`, `activating`, `failed` and so on.
        sub: More of that, such as `running` or `auto-restart`.
        restarts: How often systemd restarted it by itself.
        pid: Its process; 0 for none.
        status: What the node reports: mode, reason, rate_hz, late, blocked_by; None where it reports nothing.
    """

    load: str = "not-found"
    active: str = "inactive"
    sub: str = "dead"
    restarts: int = 0
    pid: int = 0
    status: Mapping[str, Any] | None = None

    @property
    def mode(self) -> str | None:
        """The robot's mode; None where the node runs and does not report it, or does not run."""
        return str(self.status["mode"]) if self.status and "mode" in self.status else None

    @property
    def is_armed(self) -> bool:
        """Whether the node runs and reports that the robot is armed."""
        return self.pid != 0 and self.mode in ARMED

    def why_not_safe(self) -> str | None:
        """What rules out a restart: a node that runs and is armed, or does not report whether it is."""
        if self.pid == 0:
            return None
        if self.is_armed:
            return f"the robot is {self.mode}: disarm it first"
        if self.mode is None and self.active == "active":
            return "the node does not report whether the robot is armed: stop it first (systemctl stop segway-ecc-node)"
        return None

    def blocked_by(self) -> frozenset[str]:
        """The names of the pre-arm checks that fail."""
        texts = (self.status or {}).get("blocked_by", ())
        return frozenset(str(text).partition(":")[0] for text in texts)


def show(unit: str = NODE) -> Service:
    """Ask systemd about a unit.

    Raises:
        AgentRefusedError: There is no systemd, or it does not answer.
    """
    done = run(["systemctl", "show", f"--property={_PROPERTIES}", "--", unit], 10.0)
    if done.returncode:
        raise AgentRefusedError(f"systemctl show {unit}: {done.stderr.strip() or done.returncode}")
    found = dict(line.split("=", 1) for line in done.stdout.splitlines() if "=" in line)
    try:
        status = json.loads(found.get("StatusText", ""))
    except ValueError:
        status = None
    return Service(
        load=found.get("LoadState", ""),
        active=found.get("ActiveState", ""),
        sub=found.get("SubState", ""),
        restarts=_whole(found.get("NRestarts", "")),
        pid=_whole(found.get("MainPID", "")),
        status=status if isinstance(status, dict) else None,
    )


def restart(command: Sequence[str]) -> str | None:
    """Restart the services by a command, or those of ours that are installed; why it failed, or None."""
    words = list(command)
    try:
        if not words:
            installed = [unit for unit in UNITS if unit == NODE or show(unit).load == "loaded"]
            words = ["systemctl", "restart", "--", *installed]
            run(["systemctl", "daemon-reload"], _COMMAND_S)
            # A version that kept failing may have used up the start limit, which would keep the next one down too.
            run(["systemctl", "reset-failed", "--", *installed], _COMMAND_S)
        done = run(words, _COMMAND_S)
    except AgentRefusedError as error:
        return str(error)
    return f"{' '.join(words)}: {done.stderr.strip() or done.returncode}" if done.returncode else None


def run(words: Sequence[str], within_s: float, folder: str | None = None) -> subprocess.CompletedProcess[str]:
    """Run a program to its end.

    Raises:
        AgentRefusedError: It cannot be run, or takes longer.
    """
    try:
        return subprocess.run(  # noqa: S603 - our own words, or the command that the operator gave
            words, capture_output=True, text=True, timeout=within_s, check=False, stdin=subprocess.DEVNULL, cwd=folder
        )
    except OSError as error:
        raise AgentRefusedError(f"{words[0]} cannot be run: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise AgentRefusedError(f"{' '.join(words)} took longer than {within_s:g} s") from None


def _whole(text: str) -> int:
    return int(text) if text.isdecimal() else 0


class Trial:
    """Watches a node that was just restarted; pure: it is given what systemd shows, and when.

    Args:
        for_s: How long it must be healthy on end, s.
        start_s: How long it may take besides until it is.
        rate_hz: The rate that its loop should have; None where that is not known.
        before: The node before it was restarted: what kept the robot from arming then is not held against it.
    """

    def __init__(self, for_s: float, start_s: float, rate_hz: float | None, before: Service) -> None:
        self._for_s, self._start_s = for_s, start_s
        self._rate_hz, self._before = rate_hz, before
        self._since_s: float | None = None
        self._pid = 0
        self.reason = "nothing was seen of it yet"

    def watch(self, node: Service, elapsed_s: float) -> bool | None:
        """True once it is healthy, False once it is not, for `reason`, None while that is open."""
        if (fatal := self._fatal(node)) is not None:
            self.reason = fatal
            return False
        self.reason = self._lacks(node) or ""
        if self.reason:
            self._since_s = None
            return False if elapsed_s > self._start_s + self._for_s else None
        self._pid = node.pid
        if self._since_s is None:
            self._since_s = elapsed_s
        return True if elapsed_s - self._since_s >= self._for_s else None

    def _fatal(self, node: Service) -> str | None:
        if node.load != "loaded":
            return f"{NODE} is not installed ({node.load})"
        if node.active in {"failed", "inactive"}:
            return f"{NODE} is {node.active}"
        if node.restarts not in {0, self._before.restarts}:
            return f"{NODE} had to be restarted {node.restarts} times"
        if self._pid and node.pid != self._pid:
            return f"{NODE} ended and was started again"
        if node.mode == "FAULT":
            return f"the robot is in FAULT: {(node.status or {}).get('reason', '')}"
        return None

    def _lacks(self, node: Service) -> str | None:
        if node.active != "active":
            return f"{NODE} is still {node.active} ({node.sub})"
        if node.status is None:
            return f"{NODE} reports no status"
        rate = node.status.get("rate_hz")
        if not isinstance(rate, int | float):
            return "the node does not report its rate"
        if self._rate_hz is not None and not abs(rate - self._rate_hz) <= _RATE_TOLERANCE * self._rate_hz:
            return f"its loop runs at {rate:g} Hz instead of {self._rate_hz:g} Hz"
        blocked = node.blocked_by() - _POSTURE - self._before.blocked_by()
        if blocked:
            texts = [str(t) for t in node.status["blocked_by"] if str(t).partition(":")[0] in blocked]
            return f"the robot cannot be armed: {'; '.join(texts)}"
        return None


def watched(trial: Trial, every_s: float) -> bool:
    """Watch until it is clear whether the node is healthy."""
    began_s = time.monotonic()
    while True:
        verdict = trial.watch(show(), time.monotonic() - began_s)
        if verdict is not None:
            return verdict
        time.sleep(every_s)
