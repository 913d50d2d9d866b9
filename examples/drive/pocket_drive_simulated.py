# SPDX-License-Identifier: MIT
"""The pocket drives as their firmware behaves: what stands in for them on a simulated bus."""

from pocket_drive import (
    COMMAND,
    OFF,
    ON,
    STATUS_PERIOD_S,
    TIMED_OUT,
    WATCHDOG_S,
    read_command,
    status_frame,
)

from segway_ecc.testing import SimulatedDrives


class SimulatedPocketDrives:
    """Both controllers; see `Device`."""

    def __init__(self, link, settings):
        """Switch them on."""
        self._link, self._wheels = link, settings.axes
        self.inputs = tuple(f"{name}.torque" for name in self._wheels)
        self.needs = tuple(f"{name}.{value}" for name in self._wheels for value in ("angle", "velocity"))
        self._torques, self._states = dict.fromkeys(self._wheels, 0.0), dict.fromkeys(self._wheels, OFF)
        self._commanded_ns, self._sent_ns, self.refused_frames = dict.fromkeys(self._wheels, 0), None, 0

    def obey(self, frames, now_ns, _outputs):
        """Follow the commands, and switch off where there is none for too long."""
        for frame in frames:
            for name, wheel in self._wheels.items():
                if frame.arbitration_id == COMMAND + wheel.node and not frame.is_extended:
                    self._take(name, frame)
        for name, commanded_ns in self._commanded_ns.items():
            if self._states[name] == ON and now_ns - commanded_ns > WATCHDOG_S * 1e9:
                self._states[name], self._torques[name] = TIMED_OUT, 0.0
        return [self._wheels[name].wheel_torque(torque) for name, torque in self._torques.items()]

    def send_telemetry(self, now_ns, outputs):
        """Send each wheel's status where it is due."""
        if self._sent_ns is not None and now_ns - self._sent_ns < STATUS_PERIOD_S * 1e9:
            return
        self._sent_ns = now_ns
        for name, wheel in self._wheels.items():
            angle, velocity = (wheel.motor(outputs[f"{name}.{value}"]) for value in ("angle", "velocity"))
            self._link.send(status_frame(wheel.node, angle, velocity, self._states[name]))

    def _take(self, name, frame):
        command = read_command(frame)
        if command is None:
            self.refused_frames += 1
            return
        torque, on = command
        self._commanded_ns[name] = frame.received_ns
        self._states[name] = ON if on else OFF
        self._torques[name] = torque if on else 0.0


SIMULATED = SimulatedDrives(
    tick_ns=1_000_000, device=lambda settings, link, _port: SimulatedPocketDrives(link, settings)
)
