"""The amplifiers of the three motors: which voltage arrives for a commanded one.

For the command u_i of motor i, clipped to U = 8 V:

    resolution   u_i <- round(u_i / d) d          d = 2 U / 2^bits
    dead zone    u_i <- sign(u_i) max(|u_i| - z_i, 0)
    supply sag   u_i <- u_i / (1 + r sum_j (u_j / U)^2)

The last line is a supply of U behind a resistance: motor j takes the current of its winding times its duty u_j / U.
"""

from __future__ import annotations

from dtwin.emulation.machine.sections import Drive
from dtwin.parameters import VOLTAGE_LIMIT
from dtwin.signals import DriveVector


class Amplifier:
    """Static part of the drive."""

    def __init__(self, drive: Drive) -> None:
        self._quantum = 2 * VOLTAGE_LIMIT / 2**drive.bits if drive.bits else 0.0
        self._dead_zone = drive.dead_zone
        self._sag = drive.sag

    def voltages(self, volts: DriveVector) -> DriveVector:
        """Voltages at the motors (V) for commanded ones (V); the gripper's comes as it is commanded."""
        arrived = [self._voltage(volt, dead) for volt, dead in zip(volts, self._dead_zone, strict=False)]
        if self._sag:
            factor = 1.0 / (1.0 + self._sag * sum((volt / VOLTAGE_LIMIT) ** 2 for volt in arrived))
            arrived = [factor * volt for volt in arrived]
        return arrived[0], arrived[1], arrived[2], volts[3]

    def _voltage(self, volt: float, dead: float) -> float:
        volt = min(max(volt, -VOLTAGE_LIMIT), VOLTAGE_LIMIT)
        if self._quantum:
            volt = self._quantum * round(volt / self._quantum)
        if dead:
            volt = max(volt - dead, 0.0) + min(volt + dead, 0.0)
        return volt
