# SPDX-License-Identifier: MIT
"""The change from one release to another: switch, restart, trial, and back where the new one is not healthy."""

import dataclasses
import os
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from segway_ecc.deploy.release.agent.files import AgentRefusedError
from segway_ecc.deploy.release.agent.journal import NO_WAY_BACK, WENT_BACK, Journal, Reporter, Transaction, stamp
from segway_ecc.deploy.release.agent.services import Service, Trial, restart, show, watched
from segway_ecc.deploy.release.agent.store import FAILED, HEALTHY, INTERRUPTED, NEW, Store

EXIT_CODES: Final = {HEALTHY: 0, WENT_BACK: 12, NO_WAY_BACK: 12}


@dataclass(frozen=True, slots=True)
class Rules:
    """How an update is tried.

    Attributes:
        trial_s: How long the node must be healthy on end, s.
        start_s: How long it may take until it is, s.
        keep: How many of the newest releases stay.
        restart: The command that restarts the services; empty for our own units.
    """

    trial_s: float = 10.0
    start_s: float = 30.0
    keep: int = 3
    restart: Sequence[str] = ()

    @property
    def every_s(self) -> float:
        """How often the node is looked at, s."""
        return min(0.5, self.trial_s / 4)


class Update:
    """One transaction. What it does from the switch on does not depend on whoever asked for it."""

    def __init__(self, store: Store, rules: Rules, reporter: Reporter) -> None:
        self._store, self._rules, self._reporter = store, rules, reporter
        self._journal = Journal(store.root)

    def run(self, transaction: Transaction) -> int:
        """Switch, try, and go back where that fails; the exit code is by the outcome."""
        ended = dataclasses.replace(self._try_release(transaction), ended=stamp())
        self._journal.write(ended)
        self._reporter.step("end")
        conclude(self._store, self._journal, ended)
        gone = self._store.prune(self._rules.keep, {n for n in (ended.release, ended.previous) if n})
        self._reporter.event(
            "end",
            outcome=ended.outcome,
            reason=ended.reason,
            release=ended.release,
            previous=ended.previous,
            current=self._store.current(),
            pruned=gone,
        )
        return EXIT_CODES[ended.outcome]

    def _try_release(self, transaction: Transaction) -> Transaction:
        before = show()
        if (why_not := before.why_not_safe()) is not None:
            raise AgentRefusedError(why_not)
        self._phase(transaction, "switch")
        try:
            self._store.switch(transaction.release)
            reason = self._trial_failure(transaction, before)
        except Exception as error:  # noqa: BLE001 - whatever went wrong, the robot must go back
            reason = f"{type(error).__name__}: {error}"
        if reason is None:
            return dataclasses.replace(transaction, outcome=HEALTHY, phase="trial")
        if transaction.previous is None:
            return dataclasses.replace(transaction, outcome=NO_WAY_BACK, reason=reason)
        failed = dataclasses.replace(transaction, reason=reason)
        # Somebody may have armed a robot whose trial then failed: it is not restarted under them. A node that does not
        # report its mode is not waited for: it would keep the robot in its trial for ever.
        if _is_armed():
            self._reporter.step("waiting until the robot is disarmed")
        while _is_armed():
            time.sleep(self._rules.every_s)
        self._phase(failed, "back")
        self._store.switch(transaction.previous)
        problem = restart(self._rules.restart)
        if problem is not None:
            reason = f"{reason}; and after going back: {problem}"
        return dataclasses.replace(failed, phase="back", outcome=WENT_BACK, reason=reason)

    def _trial_failure(self, transaction: Transaction, before: Service) -> str | None:
        self._phase(transaction, "restart")
        reason = restart(self._rules.restart)
        self._phase(transaction, "trial")
        if reason is not None:
            return reason
        manifest = self._store.manifest(transaction.release)
        rate_hz = manifest.rate_hz if manifest is not None else None
        trial = Trial(self._rules.trial_s, self._rules.start_s, rate_hz, before)
        return None if watched(trial, self._rules.every_s) else trial.reason

    def _phase(self, transaction: Transaction, phase: str) -> None:
        self._journal.write(dataclasses.replace(transaction, phase=phase))
        self._reporter.step(phase)


def _is_armed() -> bool:
    try:
        return show().is_armed
    except AgentRefusedError:  # a systemd that does not answer is no reason against going back
        return False


def conclude(store: Store, journal: Journal, ended: Transaction) -> None:
    """Put down in the manifest what became of the release; done again after an interruption, it does no harm."""
    manifest = store.manifest(ended.release)
    if manifest is not None:
        if ended.outcome == HEALTHY:
            manifest = dataclasses.replace(manifest, state=HEALTHY, reason="")
        elif ended.outcome in {WENT_BACK, NO_WAY_BACK}:
            manifest = dataclasses.replace(manifest, state=FAILED, reason=ended.reason)
        elif manifest.state == NEW:
            manifest = dataclasses.replace(manifest, state=INTERRUPTED, reason=ended.reason)
        manifest.write(store.folder(ended.release))
    journal.close()


def recover(store: Store, reporter: Reporter, command: Sequence[str] = (), *, restarts: bool) -> Transaction | None:
    """Settle an interrupted transaction, and return what was settled (None where nothing was pending).

    What was not found healthy by then is not kept in use.

    Raises:
        AgentRefusedError: The robot is armed, and the services would have to be restarted.
    """
    journal = Journal(store.root)
    pending = journal.pending()
    if pending is None:
        return None
    reporter.step("settle")
    if not pending.outcome:
        reason = pending.reason or f"interrupted in the phase {pending.phase!r}"
        outcome = WENT_BACK if pending.phase == "back" else INTERRUPTED
        if pending.previous is not None:
            if restarts and (why_not := show().why_not_safe()) is not None:
                raise AgentRefusedError(f"{why_not}; an update that was interrupted is to be settled")
            store.switch(pending.previous)
            if restarts and (problem := restart(command)):
                reason = f"{reason}; and after going back: {problem}"
        pending = dataclasses.replace(pending, outcome=outcome, reason=reason, ended=stamp())
        journal.write(pending)
    conclude(store, journal, pending)
    return pending


def detached(reporter: Reporter, work: Callable[[], int]) -> int:
    """Do the work in a process of its own session, which a cut connection does not end; wait for it."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    code = 1
    try:
        os.setsid()
        for number in (signal.SIGHUP, signal.SIGPIPE, signal.SIGINT):
            signal.signal(number, signal.SIG_IGN)
        reporter.detach()
        code = work()
    except AgentRefusedError as error:
        reporter.event("refused", text=str(error))
        code = 11
    except Exception as error:  # noqa: BLE001 - nobody else is there to report it
        reporter.event("failed", text=f"{type(error).__name__}: {error}")
    finally:
        os._exit(code)
