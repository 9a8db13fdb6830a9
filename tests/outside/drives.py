"""Effects and faults of amplifiers, motors, gears and loads."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np
from msgspec.structs import replace

from dtwin.parameters import PERIOD, VOLTAGE_LIMIT, ArmParameters, JointVector
from dtwin.signals import DriveVector, Truth, Voltages
from tests.outside.effect import Command, Effect, Outside, changed

ALL = (1, 2, 3)
NONE: JointVector = (0.0, 0.0, 0.0)
GRAVITY = 9.81
_ARM = ArmParameters()


def _volts(change: Callable[[float, int, float], float], joints: tuple[int, ...] = ALL) -> Command:
    """A part that changes the voltages of joints by a function of time (s), index and volts."""

    def part(command: Voltages) -> Voltages:
        first, second, third = changed(command.volts[:3], joints, lambda i, v: change(command.time, i, v))
        volts: DriveVector = (first, second, third, command.volts[3])
        return replace(command, volts=volts)

    return part


def late_commands(ticks: int, *, start: float = 0.0) -> Effect:
    """Voltages that act so many ticks late from a time (s) on."""

    def make(_: np.random.Generator) -> Outside:
        past: deque[DriveVector] = deque(maxlen=ticks + 1)

        def pass_on(command: Voltages) -> Voltages:
            past.append(command.volts)
            return replace(command, volts=past[0]) if command.time >= start else command

        return Outside(commands=(pass_on,))

    return make


def lost_commands(share: float, *, start: float = 5.0) -> Effect:
    """Commands that are lost on the way at random: the one before stays."""

    def make(random: np.random.Generator) -> Outside:
        last: list[DriveVector] = [(0.0, 0.0, 0.0, 0.0)]

        def pass_on(command: Voltages) -> Voltages:
            if command.time < start or random.random() >= share:
                last[0] = command.volts
            return replace(command, volts=last[0])

        return Outside(commands=(pass_on,))

    return make


def ripple(share: float = 0.05, frequency: float = 97.0) -> Effect:
    """A supply whose voltage ripples (share, Hz), which scales all commands by its mean over a tick."""

    def make(random: np.random.Generator) -> Outside:
        phase, turn = random.uniform(0.0, 2 * math.pi), math.pi * frequency * PERIOD
        mean = share * math.sin(turn) / turn

        def change(time: float, _: int, volts: float) -> float:
            return volts * (1 + mean * math.sin(2 * math.pi * frequency * time + turn + phase))

        return Outside(commands=(_volts(change),))

    return make


def strength(
    final: float, *, time_constant: float = 1e-9, start: float = 5.0, joints: tuple[int, ...] = ALL
) -> Effect:
    """Motors whose torque for a voltage goes to so many times what it was, such as by warming (s)."""

    def make(_: np.random.Generator) -> Outside:
        def change(time: float, _: int, volts: float) -> float:
            share = -math.expm1(-(time - start) / time_constant) if time > start else 0.0
            return volts * (1 + (final - 1) * share)

        return Outside(commands=(_volts(change, joints),))

    return make


def stuck_volts(volts: float, *, start: float = 5.0, joints: tuple[int, ...] = (1,)) -> Effect:
    """An amplifier that gives one voltage whatever is asked for."""

    def make(_: np.random.Generator) -> Outside:
        return Outside(commands=(_volts(lambda time, _, v: volts if time >= start else v, joints),))

    return make


def weak_supply(limit: float, *, start: float = 5.0) -> Effect:
    """A supply that has no more than so many volts."""

    def make(_: np.random.Generator) -> Outside:
        def change(time: float, _: int, volts: float) -> float:
            bound = limit if time >= start else VOLTAGE_LIMIT
            return max(-bound, min(bound, volts))

        return Outside(commands=(_volts(change),))

    return make


def one_way(share: float, *, joints: tuple[int, ...] = (2,)) -> Effect:
    """A half bridge that gives less of a voltage one way than the other."""

    def make(_: np.random.Generator) -> Outside:
        return Outside(commands=(_volts(lambda _t, _i, v: v if v > 0 else share * v, joints),))

    return make


def cogging(torque: float = 0.015, teeth: int = 73, *, joints: tuple[int, ...] = ALL) -> Effect:
    """Motors whose rotor rests at its teeth: a torque (N m) that changes so many times a turn."""

    def make(random: np.random.Generator) -> Outside:
        phase = random.uniform(0.0, 2 * math.pi, 3)

        def push(truth: Truth, _: Voltages) -> JointVector:
            return changed(NONE, joints, lambda i, _: torque * math.sin(teeth * truth.theta[i] + phase[i]))

        return Outside(torques=(push,))

    return make


def _rub(torque: float, omega: float) -> float:
    return -torque * max(-1.0, min(1.0, omega / 0.1))


def load_friction(share: float = 0.08) -> Effect:
    """Gears whose friction grows with the torque that they pass on."""

    def make(_: np.random.Generator) -> Outside:
        def push(truth: Truth, command: Voltages) -> JointVector:
            def rub(i: int, _: float) -> float:
                return _rub(share * abs(_ARM.voltage_constant[i] * command.volts[i]), truth.omega[i])

            return changed(NONE, ALL, rub)

        return Outside(torques=(push,))

    return make


def oil(change: float, time_constant: float = 300.0) -> Effect:
    """Bearings whose viscous damping goes to so many N m s/rad more or less while they warm (s)."""

    def make(_: np.random.Generator) -> Outside:
        def push(truth: Truth, _: Voltages) -> JointVector:
            now = change * math.expm1(-max(truth.time, 0.0) / time_constant)
            return changed(NONE, ALL, lambda i, _: now * truth.omega[i])

        return Outside(torques=(push,))

    return make


def shove(torque: float, *, length: float = 0.3, start: float = 5.0, joints: tuple[int, ...] = (1,)) -> Effect:
    """Somebody pushes joints (N m) for a while (s)."""

    def make(_: np.random.Generator) -> Outside:
        def push(truth: Truth, _: Voltages) -> JointVector:
            acts = start <= truth.time + 1e-6 < start + length
            return changed(NONE, joints, lambda _i, _v: torque if acts else 0.0)

        return Outside(torques=(push,))

    return make


def off_centre(distance: float = 0.02) -> Effect:
    """Boxes whose weight acts beside the tip (m)."""

    def make(random: np.random.Generator) -> Outside:
        angle = random.uniform(0.0, 2 * math.pi)

        def push(truth: Truth, _: Voltages) -> JointVector:
            moment = -truth.payload_mass * GRAVITY * distance * math.cos(sum(truth.theta) + angle)
            return moment, moment, moment

        return Outside(torques=(push,))

    return make


def liquid(share: float = 0.5, frequency: float = 2.5, damping: float = 0.05) -> Effect:
    """Boxes in which a share of the mass sways to and fro (Hz, share of critical damping), driven by the tip."""

    def make(_: np.random.Generator) -> Outside:
        sway, rate, last = [0.0], [0.0], [math.nan]
        w = 2 * math.pi * frequency

        def push(truth: Truth, _: Voltages) -> JointVector:
            angles = np.cumsum(truth.theta)
            lever = np.cumsum((np.asarray(_ARM.length) * np.sin(angles))[::-1])[::-1]
            speed = -float(lever @ np.asarray(truth.omega))
            drive = (speed - last[0]) / PERIOD if math.isfinite(last[0]) else 0.0
            last[0] = speed
            if truth.payload_mass == 0.0:
                sway[0] = rate[0] = 0.0
                return NONE
            rate[0] += PERIOD * (-drive - 2 * damping * w * rate[0] - w * w * sway[0])
            sway[0] += PERIOD * rate[0]
            force = share * truth.payload_mass * w * w * sway[0]
            first, second, third = (-force * lever).tolist()
            return first, second, third

        return Outside(torques=(push,))

    return make


def spring(stiffness: float, rest: float = 0.0, *, start: float = 0.0, joints: tuple[int, ...] = (1,)) -> Effect:
    """A cable that pulls joints towards an angle (N m/rad, rad)."""

    def make(_: np.random.Generator) -> Outside:
        def push(truth: Truth, _: Voltages) -> JointVector:
            acts = stiffness if truth.time >= start else 0.0
            return changed(NONE, joints, lambda i, _: acts * (rest - truth.theta[i]))

        return Outside(torques=(push,))

    return make


def rough_floor(torque: float, frequency: float = 11.0) -> Effect:
    """A bench that shakes: torques (N m) on all joints at a frequency (Hz)."""

    def make(random: np.random.Generator) -> Outside:
        phase = random.uniform(0.0, 2 * math.pi, 3)

        def push(truth: Truth, _: Voltages) -> JointVector:
            return changed(NONE, ALL, lambda i, _: torque * math.sin(2 * math.pi * frequency * truth.time + phase[i]))

        return Outside(torques=(push,))

    return make


def tight_spot(torque: float, angle: float, *, width: float = 0.1, start: float = 5.0, joint: int = 1) -> Effect:
    """A bearing that rubs at one angle (rad) of a joint (N m)."""

    def make(_: np.random.Generator) -> Outside:
        def push(truth: Truth, _: Voltages) -> JointVector:
            i = joint - 1
            near = truth.time >= start and abs(truth.theta[i] - angle) < width
            return changed(NONE, (joint,), lambda i, _: _rub(torque if near else 0.0, truth.omega[i]))

        return Outside(torques=(push,))

    return make
