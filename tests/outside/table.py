"""The effects that a healthy arm may have, and the faults: fixed before anything was tuned on them."""

from __future__ import annotations

import math
from typing import Final

from tests.outside import drives, readings
from tests.outside.effect import Effect, together

EFFECTS: Final[dict[str, Effect]] = {
    "correction table, 3 mrad": readings.corrected(),
    "correction table, 1 mrad, 14 bits": readings.corrected(0.001, 2 * math.pi / 16384),
    "eccentric disks, 2 mrad": readings.eccentric(0.002),
    "sample jitter, 1 ms": readings.jitter(0.001),
    "hum in the readings, 1 mrad": readings.hum(0.001),
    "1 % of the readings repeated": readings.drop(0.01),
    "a burst once a minute, all encoders": readings.burst(every=60.0),
    "a burst once a minute, encoder 2": readings.burst(every=60.0, joints=(2,)),
    "supply ripple, 5 %": drives.ripple(),
    "supply ripple, 10 % at 61 Hz": drives.ripple(0.1, 61.0),
    "motors warm, K -8 % in 10 minutes": drives.strength(0.92, time_constant=200.0, start=0.0),
    "bearings warm, D -40 % in 5 minutes": drives.oil(-0.02, 100.0),
    "cold oil, D +40 %": drives.oil(0.02, 1.0),
    "cogging, 5 mN m, 73 a turn": drives.cogging(0.005),
    "cogging, 8 mN m, 24 a turn": drives.cogging(0.008, 24),
    "gear friction of 8 % of the torque": drives.load_friction(),
    "gear friction of 15 % of the torque": drives.load_friction(0.15),
    "liquid boxes, half the mass": drives.liquid(),
    "boxes held 20 mm off their centre": drives.off_centre(),
    "a cable, 0.02 N m/rad on joint 1": drives.spring(0.02),
    "a bench that shakes, 10 mN m at 11 Hz": drives.rough_floor(0.01),
    "half bridge of motor 2, 95 % one way": drives.one_way(0.95),
    "commands a tick late": drives.late_commands(1),
    "0.5 % of the commands lost": drives.lost_commands(0.005, start=0.0),
    "ripple, jitter and a correction table": together(
        drives.ripple(0.03), readings.corrected(0.001, 2 * math.pi / 16384), readings.jitter(0.0005)
    ),
}
"""Effects of moderate size, by what they are."""

FAULTS: Final[dict[str, Effect]] = {
    "a burst every 7 s, all encoders": readings.burst(every=7.0),
    "a burst every 7 s, encoder 1": readings.burst(every=7.0, joints=(1,)),
    "a burst of 60 ms every 9 s, all encoders": readings.burst(every=9.0, length=0.06),
    "bursts without end, encoder 3": readings.burst(every=0.05, joints=(3,)),
    **{f"encoder {j} freezes for 100 ms pieces": readings.freeze(joints=(j,)) for j in (1, 2, 3)},
    "all encoders freeze for 100 ms pieces": readings.freeze(joints=(1, 2, 3)),
    "encoder 2 freezes for 1 s pieces": readings.freeze(every=4.0, length=1.0, joints=(2,)),
    "encoder 1 stops": readings.freeze(every=1e6, length=1e6, start=6.2),
    **{f"encoder {j} jumps by 0.2 rad": readings.jump(0.2, start=6.2, joints=(j,)) for j in (1, 2, 3)},
    **{f"encoder {j} jumps by 1.5 rad": readings.jump(1.5, start=6.2, joints=(j,)) for j in (1, 2, 3)},
    "encoder 2 jumps by 0.3 rad for 0.5 s": readings.jump(0.3, start=6.2, length=0.5, joints=(2,)),
    "encoder 1 reads 80 %": readings.scale(0.8),
    "encoder 3 reads 125 %": readings.scale(1.25, joints=(3,)),
    **{f"encoder {j} reads the other sign": readings.scale(-1.0, joints=(j,)) for j in (1, 2, 3)},
    "the disk of encoder 1 slips by 5 %": readings.slip(0.05),
    "frames of encoder 2 read 0, 1 in 200": readings.zeros(0.005),
    "encoders 2 and 3 change places": readings.swap(2, 3),
    "readings 3 ticks late": readings.late_readings(3, start=5.0),
    "commands 3 ticks late": drives.late_commands(3, start=5.0),
    "20 % of the commands lost": drives.lost_commands(0.2),
    "cogging, 15 mN m, 73 a turn": drives.cogging(),
    "cogging, 25 mN m, 41 a turn": drives.cogging(0.025, 41),
    "motor 2 at 60 %": drives.strength(0.6, joints=(2,)),
    "motor 1 loses 3 % a second": drives.strength(0.4, time_constant=15.0, joints=(1,)),
    "amplifier 1 stuck at 4 V": drives.stuck_volts(4.0),
    "amplifier 3 stuck at 0 V": drives.stuck_volts(0.0, joints=(3,)),
    "a supply of 4 V": drives.weak_supply(4.0),
    "joint 1 shoved with 1.5 N m for 0.3 s": drives.shove(1.5, start=6.2),
    "joint 2 shoved with 0.8 N m for 0.5 s": drives.shove(0.8, length=0.5, start=6.2, joints=(2,)),
    "a cable, 0.3 N m/rad on joint 1": drives.spring(0.3, start=5.0),
    "a tight bearing at 1 rad of joint 1": drives.tight_spot(1.0, 1.0),
}
"""Faults, by what they are."""

_NOTHING_FITS: Final = ("unknown1", "unknown2", "unknown3")
"""What is right where no cause of the monitor's list is what happened: to say so, or to name nothing."""

NAMES: Final[dict[str, tuple[str, ...]]] = {
    # Bursts are told as events with a count and a rate; no finding follows from them.
    "a burst every 7 s, all encoders": _NOTHING_FITS,
    "a burst every 7 s, encoder 1": _NOTHING_FITS,
    "a burst of 60 ms every 9 s, all encoders": _NOTHING_FITS,
    "bursts without end, encoder 3": _NOTHING_FITS,
    "frames of encoder 2 read 0, 1 in 200": _NOTHING_FITS,
    **{f"encoder {j} freezes for 100 ms pieces": (f"freeze{j}",) for j in (1, 2, 3)},
    "all encoders freeze for 100 ms pieces": ("freeze1", "freeze2", "freeze3"),
    "encoder 2 freezes for 1 s pieces": ("freeze2",),
    "encoder 1 stops": ("freeze1",),
    **{f"encoder {j} jumps by 0.2 rad": (f"bias{j}",) for j in (1, 2, 3)},
    **{f"encoder {j} jumps by 1.5 rad": (f"bias{j}",) for j in (1, 2, 3)},
    "encoder 2 jumps by 0.3 rad for 0.5 s": ("bias2",),
    "encoder 1 reads 80 %": ("scale1",),
    "encoder 3 reads 125 %": ("scale3",),
    **{f"encoder {j} reads the other sign": (f"scale{j}",) for j in (1, 2, 3)},
    # From when it slips the reading is a share of the angle and an offset.
    "the disk of encoder 1 slips by 5 %": ("scale1", "bias1"),
    "encoders 2 and 3 change places": _NOTHING_FITS,
    # The loop does not tell which way is late.
    "readings 3 ticks late": ("late",),
    "commands 3 ticks late": ("late",),
    "20 % of the commands lost": ("late",),
    "cogging, 15 mN m, 73 a turn": _NOTHING_FITS,
    "cogging, 25 mN m, 41 a turn": _NOTHING_FITS,
    "motor 2 at 60 %": ("K2",),
    "motor 1 loses 3 % a second": ("K1",),
    # No command arrives, though a voltage does.
    "amplifier 1 stuck at 4 V": ("cut1", "unknown1"),
    "amplifier 3 stuck at 0 V": ("cut3",),
    "a supply of 4 V": ("supply",),
    "joint 1 shoved with 1.5 N m for 0.3 s": ("push1",),
    "joint 2 shoved with 0.8 N m for 0.5 s": ("push2",),
    "a cable, 0.3 N m/rad on joint 1": _NOTHING_FITS,
    # It may be too tight for the joint to get past.
    "a tight bearing at 1 rad of joint 1": ("D1", "mu1", "lock1"),
}
"""What a finding may rightly call each fault, written down before any monitor had seen one."""
