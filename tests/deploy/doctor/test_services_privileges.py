# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict
from segway_ecc.deploy.doctor.services import check_privileges
from tests.deploy.doctor.fake_machine import NODE_UNIT, FakeMachine, by_name, workload

REFUSED = "!/usr/bin/python3: PermissionError: [Errno 1] Operation not permitted"
LIMITS = "Max locked memory         {}              9999999              bytes     \n"


def looked(fake: FakeMachine, robot: str | None = "cart-can") -> dict[str, Finding]:
    return by_name(list(check_privileges(fake.machine, workload(fake.root, robot))))


@pytest.fixture
def user(fake: FakeMachine) -> FakeMachine:
    """The same without our unit: what this user may is what counts."""
    del fake.answers["segway-ecc-node"]
    fake.answers["sched_setscheduler"] = ""
    return fake


def test_the_units_word(fake: FakeMachine) -> None:
    found = looked(fake)
    assert {each.verdict for each in found.values()} == {Verdict.GOOD}
    assert found["real-time scheduling"].found == "SCHED_FIFO for segway-ecc-node.service, by its unit"
    assert found["memory lock"].found == "any amount for segway-ecc-node.service, by its unit"


def test_a_unit_without_privileges_is_bad_whatever_this_user_may(fake: FakeMachine) -> None:
    fake.answers["sched_setscheduler"] = ""
    fake.answers["segway-ecc-node"] = (
        "LoadState=loaded\nCPUSchedulingPolicy=0\nLimitMEMLOCK=8388608\nAmbientCapabilities=\nUser=segway\n"
    )
    found = looked(fake)
    assert found["real-time scheduling"].verdict is Verdict.BAD
    assert "sudo systemctl edit segway-ecc-node.service" in found["real-time scheduling"].remedy
    assert found["memory lock"].verdict is Verdict.WARNING
    assert found["memory lock"].found == "8.0 MiB at most"


def test_a_systemd_that_names_policies(fake: FakeMachine) -> None:
    unit = NODE_UNIT.replace("cap_ipc_lock cap_sys_nice", "").replace("Policy=1", "Policy=fifo")
    fake.answers["segway-ecc-node"] = unit
    assert {each.verdict for each in looked(fake).values()} == {Verdict.GOOD}


@pytest.mark.parametrize("user", ["", "root"])
def test_a_unit_of_root(fake: FakeMachine, user: str) -> None:
    fake.answers["segway-ecc-node"] = f"LoadState=loaded\nCPUSchedulingPolicy=0\nLimitMEMLOCK=65536\nUser={user}\n"
    assert {each.verdict for each in looked(fake).values()} == {Verdict.GOOD}


def test_a_unit_may_ask_by_itself_with_the_capability(fake: FakeMachine) -> None:
    fake.answers["segway-ecc-node"] = NODE_UNIT.replace("Policy=1", "Policy=0").replace("infinity", "65536")
    assert {each.verdict for each in looked(fake).values()} == {Verdict.GOOD}


def test_a_user_who_may(user: FakeMachine) -> None:
    assert looked(user)["real-time scheduling"].found == "SCHED_FIFO 50 granted to this user"


@pytest.mark.parametrize(("robot", "verdict"), [("cart-can", Verdict.BAD), ("cart", Verdict.WARNING)])
def test_a_user_who_may_not(user: FakeMachine, robot: str, verdict: Verdict) -> None:
    user.answers["sched_setscheduler"] = REFUSED
    found = looked(user, robot)["real-time scheduling"]
    assert found.verdict is verdict
    assert found.found == "SCHED_FIFO 50 refused to this user: Operation not permitted"
    assert '"$USER - rtprio 50" | sudo tee --append /etc/security/limits.d/segway-ecc.conf' in found.remedy


@pytest.mark.parametrize(
    ("limit", "capabilities", "verdict", "text"),
    [
        ("8388608", "0000000000000000", Verdict.WARNING, "8.0 MiB at most"),
        ("unlimited", "0000000000000000", Verdict.GOOD, "any amount for this user"),
        ("8388608", "0000000000004000", Verdict.GOOD, "any amount for this user"),
        ("8388608", "0000000000008000", Verdict.WARNING, "8.0 MiB at most"),
    ],
)
def test_locked_memory_of_this_user(
    user: FakeMachine, limit: str, capabilities: str, verdict: Verdict, text: str
) -> None:
    user.write({"/proc/self/limits": LIMITS.format(limit), "/proc/self/status": f"CapEff:\t{capabilities}\n"})
    found = looked(user)["memory lock"]
    assert (found.verdict, found.found) == (verdict, text)


def test_locked_memory_is_not_known(user: FakeMachine) -> None:
    user.remove("/proc/self/limits").remove("/proc/self/status")
    assert looked(user)["memory lock"].found == "the limit is not known"


@pytest.mark.parametrize(
    ("runtime", "verdict", "text"),
    [
        ("950000", Verdict.GOOD, "real-time programs get 95% of each 1 s"),
        ("-1", Verdict.WARNING, "off"),
        ("0", Verdict.BAD, "0 us for real-time programs"),
    ],
)
def test_throttling(fake: FakeMachine, runtime: str, verdict: Verdict, text: str) -> None:
    fake.write({"/proc/sys/kernel/sched_rt_runtime_us": f"{runtime}\n"})
    found = looked(fake)["real-time throttling"]
    assert (found.verdict, found.found) == (verdict, text)


def test_a_kernel_without_throttling(fake: FakeMachine) -> None:
    fake.remove("/proc/sys/kernel/sched_rt_runtime_us")
    assert looked(fake)["real-time throttling"].verdict is Verdict.GOOD
