# SPDX-License-Identifier: MIT
"""Updates on a real init system: an unhealthy one goes back, a good one stays, and a power cut undoes a trial."""

import sys
from pathlib import Path

import pytest

from tests.deploy.image.conftest import RECIPE
from tests.deploy.image.robot import NODE, Robot, SwitchOn
from tests.deploy.image.updates import RELEASES, Updates

pytestmark = [pytest.mark.image, pytest.mark.timeout(1500)]
PYTHON = f"{sys.version_info.major}.{sys.version_info.minor}"
TOO_LONG_S = 0.05
WENT_BACK = 12
# The health check is to find out by itself, and a busy host must not make the watchdog end what is good.
UNWATCHED = "TimeoutStartSec=infinity\\nWatchdogSec=0"


def test_an_update_that_is_not_healthy_goes_back_a_good_one_stays_and_a_power_cut_undoes_a_trial(
    switch_on: SwitchOn, tmp_path: Path
) -> None:
    with switch_on(tmp_path / "first") as machine:
        robot = Robot(machine)
        robot.drop_in(NODE, UNWATCHED)
        robot.wait_until_up()
        robot.mask_guard()
        updates = Updates.on(robot, RECIPE.epoch, PYTHON)
        shipped = updates.current()
        for name, sleep_s in (("slow", TOO_LONG_S), ("good", 0.0), ("slower", 2 * TOO_LONG_S)):
            updates.make(name, sleep_s)
        code, ended = updates.push("slow", 10)
        assert (code, ended["outcome"], ended["current"]) == (WENT_BACK, "went-back", shipped)
        assert "after going back" not in ended["reason"], "the old one starts again"
        robot.wait_until_up()
        assert (updates.current(), updates.running()) == (shipped, shipped)
        assert robot.status()["mode"] == "DISARMED"
        code, ended = updates.push("good", 600)
        assert (code, ended["outcome"]) == (0, "healthy")
        good = str(ended["current"])
        assert good != shipped
        assert (updates.current(), updates.running()) == (good, good)
        # The image's release lies below the overlay, and pruning begins with a renaming.
        machine.run(
            f"python3 -c \"import os; p = '{RELEASES}{shipped}'; os.rename(p, p + '+'); os.rename(p + '+', p)\""
        )
        updates.begin("slower")
        on_trial = updates.current()
        assert on_trial not in {good, shipped}
    with switch_on(tmp_path / "second") as machine:
        robot = Robot(machine)
        robot.is_patient()
        robot.wait_until_up()
        updates = Updates(robot)
        assert (updates.current(), updates.running()) == (good, good)
        shown = machine.run("segway-ecc --version; cat /opt/segway-ecc/last-transaction.json")
        assert '"outcome": "interrupted"' in shown
        assert f'"release": "{on_trial}"' in shown
        settled = "InactiveExitTimestampMonotonic"
        assert 0 < int(robot.property(settled, "segway-ecc-settle.service")) < int(robot.property(settled))
