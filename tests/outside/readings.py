"""Effects and faults of encoders and of the way from them to the controller."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from msgspec.structs import replace

from dtwin.parameters import JointVector
from dtwin.signals import Sensors, Truth
from tests.outside.effect import Effect, Outside, Reading, changed

ALL = (1, 2, 3)


def _during(read: Reading, start: float, length: float = math.inf, every: float = math.inf) -> Reading:
    """A part that acts from a time on, for a while, and every so often again; all in s."""

    def part(sensors: Sensors, truth: Truth) -> Sensors:
        since = sensors.time - start + 1e-6
        return read(sensors, truth) if since >= 0 and since % every < length else sensors

    return part


def burst(
    *, every: float = 7.0, length: float = 0.02, wild: float = 3.0, start: float = 5.0, joints: tuple[int, ...] = ALL
) -> Effect:
    """Electromagnetic interference: wild values (up to so many rad off) for a while (s), every so often (s)."""

    def make(random: np.random.Generator) -> Outside:
        def read(sensors: Sensors, _: Truth) -> Sensors:
            theta = changed(sensors.theta, joints, lambda _, angle: angle + random.uniform(-wild, wild))
            return replace(sensors, theta=theta)

        return Outside((_during(read, start, length, every),))

    return make


def freeze(*, every: float = 0.2, length: float = 0.1, start: float = 5.0, joints: tuple[int, ...] = (1,)) -> Effect:
    """Encoders that repeat their last reading for a while (s), every so often (s)."""

    def make(_: np.random.Generator) -> Outside:
        last: list[JointVector] = [(0.0, 0.0, 0.0)]

        def stand(sensors: Sensors, _: Truth) -> Sensors:
            return replace(sensors, theta=changed(sensors.theta, joints, lambda i, _: last[0][i]))

        frozen = _during(stand, start, length, every)

        def read(sensors: Sensors, truth: Truth) -> Sensors:
            given = frozen(sensors, truth)
            last[0] = given.theta
            return given

        return Outside((read,))

    return make


def jump(size: float, *, start: float = 5.0, length: float = math.inf, joints: tuple[int, ...] = (1,)) -> Effect:
    """Encoders that read an offset (rad) more from a time (s) on, for a while (s)."""

    def make(_: np.random.Generator) -> Outside:
        def read(sensors: Sensors, _: Truth) -> Sensors:
            return replace(sensors, theta=changed(sensors.theta, joints, lambda _, angle: angle + size))

        return Outside((_during(read, start, length),))

    return make


def scale(factor: float, *, start: float = 5.0, joints: tuple[int, ...] = (1,)) -> Effect:
    """Encoders that read so many times the angle from a time (s) on; -1 is a wrong sign."""

    def make(_: np.random.Generator) -> Outside:
        def read(sensors: Sensors, _: Truth) -> Sensors:
            return replace(sensors, theta=changed(sensors.theta, joints, lambda _, angle: factor * angle))

        return Outside((_during(read, start),))

    return make


def slip(rate: float, *, start: float = 5.0, joints: tuple[int, ...] = (1,)) -> Effect:
    """A loose encoder disk: readings that miss a share of every motion from a time (s) on."""

    def make(_: np.random.Generator) -> Outside:
        lost, last = [0.0, 0.0, 0.0], [math.nan, math.nan, math.nan]

        def slide(i: int, angle: float) -> float:
            lost[i] += rate * (angle - last[i]) if math.isfinite(last[i]) else 0.0
            last[i] = angle
            return angle - lost[i]

        def read(sensors: Sensors, _: Truth) -> Sensors:
            return replace(sensors, theta=changed(sensors.theta, joints, slide))

        return Outside((_during(read, start),))

    return make


def corrected(error: float = 0.003, step: float = 2 * math.pi / 4096, knots: int = 64) -> Effect:
    """Encoders with a correction table: readings of a grid (rad), off it by the error of interpolation (rad)."""

    def make(random: np.random.Generator) -> Outside:
        tables = random.uniform(-error, error, (3, knots + 1))
        tables[:, -1] = tables[:, 0]
        places = np.linspace(0.0, 2 * math.pi, knots + 1)

        def correct(i: int, angle: float) -> float:
            code = step * round(angle / step)
            return code + float(np.interp(code % (2 * math.pi), places, tables[i]))

        def read(sensors: Sensors, _: Truth) -> Sensors:
            return replace(sensors, theta=changed(sensors.theta, ALL, correct))

        return Outside((read,))

    return make


def eccentric(amplitude: float, *, joints: tuple[int, ...] = ALL) -> Effect:
    """Encoder disks off their centre: an error (rad) once a turn."""

    def make(random: np.random.Generator) -> Outside:
        phase = random.uniform(0.0, 2 * math.pi, 3)

        def read(sensors: Sensors, _: Truth) -> Sensors:
            error = changed(sensors.theta, joints, lambda i, angle: angle + amplitude * math.sin(angle + phase[i]))
            return replace(sensors, theta=error)

        return Outside((read,))

    return make


def drop(share: float, *, start: float = 5.0, joints: tuple[int, ...] = ALL) -> Effect:
    """A bad contact: readings that repeat the one before, at random."""

    def make(random: np.random.Generator) -> Outside:
        last: list[JointVector | None] = [None]

        def read(sensors: Sensors, _: Truth) -> Sensors:
            before = last[0]
            if before is not None and sensors.time >= start and random.random() < share:
                sensors = replace(sensors, theta=changed(sensors.theta, joints, lambda i, _: before[i]))
            last[0] = sensors.theta
            return sensors

        return Outside((read,))

    return make


def zeros(share: float, *, start: float = 5.0, joints: tuple[int, ...] = (2,)) -> Effect:
    """A frame that is lost on the way reads 0 rad, at random."""

    def make(random: np.random.Generator) -> Outside:
        def read(sensors: Sensors, _: Truth) -> Sensors:
            if random.random() >= share:
                return sensors
            return replace(sensors, theta=changed(sensors.theta, joints, lambda _i, _angle: 0.0))

        return Outside((_during(read, start),))

    return make


def swap(first: int, second: int, *, start: float = 5.0) -> Effect:
    """Two encoders that change places from a time (s) on."""

    def make(_: np.random.Generator) -> Outside:
        def read(sensors: Sensors, _: Truth) -> Sensors:
            theta = list(sensors.theta)
            theta[first - 1], theta[second - 1] = theta[second - 1], theta[first - 1]
            return replace(sensors, theta=(theta[0], theta[1], theta[2]))

        return Outside((_during(read, start),))

    return make


def late_readings(ticks: int, *, start: float = 0.0) -> Effect:
    """Angles that come so many ticks late from a time (s) on."""

    def make(_: np.random.Generator) -> Outside:
        past: deque[JointVector] = deque(maxlen=ticks + 1)

        def read(sensors: Sensors, _: Truth) -> Sensors:
            past.append(sensors.theta)
            return replace(sensors, theta=past[0]) if sensors.time >= start else sensors

        return Outside((read,))

    return make


def jitter(deviation: float = 0.001) -> Effect:
    """Samples taken too early or too late, all angles at once (s, standard deviation)."""

    def make(random: np.random.Generator) -> Outside:
        def read(sensors: Sensors, truth: Truth) -> Sensors:
            late = random.normal(0.0, deviation)
            return replace(sensors, theta=changed(sensors.theta, ALL, lambda i, angle: angle + late * truth.omega[i]))

        return Outside((read,))

    return make


def hum(amplitude: float, frequency: float = 50.5) -> Effect:
    """Mains in the cables: a sine (rad, Hz) on all readings."""

    def make(random: np.random.Generator) -> Outside:
        phase = random.uniform(0.0, 2 * math.pi)

        def read(sensors: Sensors, _: Truth) -> Sensors:
            error = amplitude * math.sin(2 * math.pi * frequency * sensors.time + phase)
            return replace(sensors, theta=changed(sensors.theta, ALL, lambda _, angle: angle + error))

        return Outside((read,))

    return make
