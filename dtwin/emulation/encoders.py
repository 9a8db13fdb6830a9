"""Absolute encoders, with noise, a machine's errors and faults: what the sensors say, as opposed to the truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, get_args

import msgspec

from dtwin.emulation.generators import generator_state, set_generator_state
from dtwin.emulation.machine.encoding import Encoding, EncodingState
from dtwin.errors import ParameterError, choices
from dtwin.parameters import CellJoints, every_joint

if TYPE_CHECKING:
    import numpy as np

NoiseKind = Literal["none", "uniform", "gaussian"]
NOISE_KINDS: Final[tuple[str, ...]] = get_args(NoiseKind)

_BLOCK: Final = 4096
"""Number of samples drawn at once: one at a time would cost more than the rest of the tick."""


@dataclass(frozen=True, slots=True)
class EncoderFaults:
    """Faults of the three joint encoders: readings are scale times as large, plus offset + rate t; some have stopped.

    The offset is in rad, the rate in rad/s, t is the plant time in s; the numbers of stopped encoders are 1 to 3.
    """

    offset: CellJoints = every_joint(0.0)
    rate: CellJoints = every_joint(0.0)
    frozen: frozenset[int] = frozenset()
    scale: CellJoints = every_joint(1.0)


HEALTHY: Final = EncoderFaults()


def check_noise(kind: NoiseKind, magnitude: float) -> None:
    """Checks a kind of encoder noise and its magnitude (rad).

    Raises:
        ParameterError: the kind is unknown, or the magnitude is negative or not finite.
    """
    if kind not in NOISE_KINDS:
        raise ParameterError(f"noise kind {kind!r}: expected {choices(NOISE_KINDS)}")
    if not (math.isfinite(magnitude) and magnitude >= 0):
        raise ParameterError(f"noise: expected a finite magnitude of at least 0 rad, got {magnitude}")


class EncodersState(msgspec.Struct, frozen=True):
    """What the next measurements depend on, beside the faults.

    Attributes:
        generator: state of the random generator before it drew the block of errors in use.
        used: number of samples of this block that have been used.
        last: last readings of joints 1 to 3 and the gripper, rad; empty before the first.
        encoding: state of a machine's encoders, None for ideal ones.
    """

    generator: str
    used: int
    last: list[float]
    encoding: EncodingState | None = None


class Encoders:
    """Measures the joints and the gripper.

    Args:
        kind: "none"; "uniform" adds N u with u uniform in [0, 1), which has the mean N/2; "gaussian" adds normal
            noise of mean 0 and standard deviation N.
        magnitude: N, rad.
        generator: random generator of the noise, used for nothing else.
        encoding: encoders of a machine, which read the noisy angles; None for encoders of infinite resolution.

    Raises:
        ParameterError: the kind is unknown, or N is negative or not finite.
    """

    def __init__(
        self,
        kind: NoiseKind,
        magnitude: float,
        generator: np.random.Generator,
        encoding: Encoding | None = None,
    ) -> None:
        check_noise(kind, magnitude)
        self._noisy = kind != "none" and magnitude > 0
        self._magnitude = magnitude
        self._generator = generator
        self._encoding = encoding
        self._draw = generator.random if kind == "uniform" else generator.standard_normal
        self._before = generator_state(generator)
        self._errors: list[list[float]] = []
        self._used = 0
        self._faults = HEALTHY
        self._faulty = False
        self._last: list[float] = []

    def set_faults(self, faults: EncoderFaults) -> None:
        """Sets the faults that hold from the next measurement on."""
        self._faults = faults
        self._faulty = faults != HEALTHY

    def measure(self, angles: list[float], time: float) -> list[float]:
        """Readings (rad) for the true angles of joints 1 to 3 and the gripper (rad) at a plant time (s)."""
        if self._noisy:
            if self._used == len(self._errors):
                self._draw_errors()
            errors = self._errors[self._used]
            self._used += 1
            angles = [angle + error for angle, error in zip(angles, errors, strict=True)]
        if self._encoding is not None:
            angles = self._encoding.read(angles)
        if self._faulty:
            angles = self._distort(angles, time)
        self._last = angles
        return angles

    def errors(self, count: int) -> list[list[float]] | None:
        """What the next readings differ by from the angles, rad, four each, at most `count`; empty if exact.

        It is None if encoders do more than to add noise.
        """
        if self._encoding is not None or self._faulty:
            return None
        if not self._noisy:
            return []
        if self._used == len(self._errors):
            self._draw_errors()
        return self._errors[self._used : self._used + count]

    def skip(self, count: int, last: list[float]) -> None:
        """Leaves out readings that somebody made of `errors`, of which the last one is given, rad."""
        self._used += count if self._noisy else 0
        self._last = last

    def state(self) -> EncodersState:
        """What the next measurements depend on, beside the faults."""
        encoding = None if self._encoding is None else self._encoding.state()
        return EncodersState(self._before, self._used, self._last, encoding)

    def restore(self, state: EncodersState) -> None:
        """Goes on where encoders of the same kind and magnitude were."""
        set_generator_state(self._generator, state.generator)
        self._errors = []
        if state.used:
            self._draw_errors()
        self._used = state.used
        self._last = state.last
        if self._encoding is not None and state.encoding is not None:
            self._encoding.restore(state.encoding)

    def _draw_errors(self) -> None:
        """Draws a block of the four errors of each sample, rad."""
        self._before = generator_state(self._generator)
        self._errors = (self._magnitude * self._draw((_BLOCK, 4))).tolist()
        self._used = 0

    def _distort(self, angles: list[float], time: float) -> list[float]:
        readings = list(angles)
        faults = self._faults
        for i in range(3):
            if i + 1 in faults.frozen and self._last:
                readings[i] = self._last[i]
            else:
                readings[i] = faults.scale[i] * readings[i] + (faults.offset[i] + faults.rate[i] * time)
        return readings
