# SPDX-License-Identifier: MIT
"""A fault that makes no sense is refused, with those that do."""

import pytest

from segway_ecc.hil.faults.fault import KINDS, Fault
from segway_ecc.node.documents import decode_yaml
from segway_ecc.node.errors import ConfigurationError


def decoded(text: str) -> Fault:
    return decode_yaml(text, Fault, "fault.yaml")


def test_a_fault_is_read() -> None:
    fault = decoded("{target: can, type: delayed, at_s: 1.5, for_s: 0.5, amount: 0.25}")
    assert (fault.target, fault.type, fault.at_s, fault.for_s, fault.size) == ("can", "delayed", 1.5, 0.5, 0.25)


def test_without_an_amount_the_usual_one_holds() -> None:
    assert decoded("{target: process, type: stuck, at_s: 1}").size == 0.2
    assert decoded("{target: encoder, type: stuck, at_s: 1}").size is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{target: serial, type: delayed, at_s: 1}", "serial cannot be delayed; it can be off, stuck, garbage"),
        ("{target: clock, type: intermittent, at_s: 1}", "clock cannot be intermittent; it can be stuck, wrong, slow"),
        ("{target: encoder, type: stuck, at_s: 1, amount: 2}", "amount has no meaning where encoder is stuck"),
        ("{target: can, type: intermittent, at_s: 1, amount: 1.5}", "must be from 0 to 1 (probability), not 1.5"),
        ("{target: can, type: delayed, at_s: 1, amount: .nan}", "amount must be from 0.001 to 60 (s), not nan"),
        ("{target: process, type: stuck, at_s: 1, for_s: 1}", "for_s has no meaning where process is stuck"),
        ("{target: drive, type: 'off', at_s: 1, for_s: 1}", "for_s has no meaning where drive is off"),
        ("{target: can, type: stuck, at_s: -1}", "at_s"),
        ("{target: can, type: stuck, at_s: 1, for_s: 0}", "for_s"),
        ("{target: wheel, type: stuck, at_s: 1}", "allowed is battery, can, clock, command_link, disk, drive, encoder"),
        ("{target: can, type: broken, at_s: 1}", "allowed is delayed, garbage, intermittent, off, oscillating, slow"),
        ("{target: can, type: stuck, at_s: 1, hard: 1}", "unknown field `hard`"),
        ("{target: can, type: stuck, at_s: 1, every_s: 1}", "every_s needs a for_s that is shorter"),
        ("{target: can, type: stuck, at_s: 1, for_s: 1, every_s: 1}", "every_s needs a for_s that is shorter"),
        ("{target: parameter, type: wrong, at_s: 1}", "parameter needs a name, that of a variable of the model"),
        ("{target: motor, type: stuck, at_s: 1}", "motor needs a name, that of an axis"),
        ("{target: motor, type: swapped, at_s: 1, name: elbow}", "motor cannot be swapped; it can be off, stuck"),
        ("{target: encoder, type: swapped, at_s: 1, name: elbow}", "encoder that is swapped is left and right"),
        ("{target: can, type: stuck, at_s: 1, name: Track}", "name has no meaning where can is stuck"),
        ("{target: imu, type: stuck, at_s: 1, name: angular_velocity_x}", "name has no meaning where imu is stuck"),
        ("{target: imu, type: wrong, at_s: 1, name: gyro}", "is one of angular_velocity_x, angular_velocity_y, "),
        ("{target: can, type: stuck, at_s: 1, since: noon}", "since"),
    ],
)
def test_what_makes_no_sense_is_refused_with_what_does(text: str, message: str) -> None:
    with pytest.raises(ConfigurationError) as raised:
        decoded(text)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_every_usual_amount_is_an_allowed_one() -> None:
    for target, kinds in KINDS.items():
        for name, kind in kinds.items():
            if kind.amount is not None:
                variable = {"parameter": "WheelRadius", "motor": "elbow"}.get(target)
                fault = Fault(target=target, type=name, at_s=0.0, amount=kind.amount, name=variable)
                assert fault.size == kind.amount
