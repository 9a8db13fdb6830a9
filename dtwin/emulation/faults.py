"""Faults of the cell as scheduled changes: `K2*=0.1@45`, `bias1+=0.02@30-60`, `lock2@30-35`, `slip@30`.

    fault  = change "@" start [ "-" end ]                     seconds of plant time; without an end it stays
    change = parameter ("*=" | "+=" | "=") number             K, m, I, l, c, D or mu of joint 1, 2 or 3
           | "payload" ("*=" | "+=" | "=") number             mass of any box while it is held, kg
           | "pads" ("*=" | "+=" | "=") number                friction between pads and boxes, with contact only
           | ("bias" | "drift") joint "+=" number             error added to the encoder's reading, rad or rad/s
           | "scale" joint "*=" number                        encoder's reading is so many times as large
           | ("freeze" | "lock" | "cut") joint                encoder stops; joint is held; voltage does not arrive
           | "cutgripper"                                     voltage does not arrive at the gripper's motor
           | "supply" ("*=" | "+=" | "=") number              share of the commanded voltages that reaches the joints
           | "late"                                           commands act one period later than they did
           | "push" joint "+=" number                         torque on the joint from outside, N m
           | "slip"                                           the held box is lost

Faults that overlap apply in the order of their starts; at its end a fault is undone and the others stay.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from dtwin.emulation.encoders import HEALTHY, EncoderFaults
from dtwin.errors import FaultError, ParameterError, choices
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, CellJoints, every_joint
from dtwin.signals import LATEST, DriveVector
from dtwin.task import BoxStream

GRAMMAR: Final = "TARGET [*=|+=|= NUMBER] @ START [- END], as in K2*=0.1@45, D1+=0.05@30-60, freeze2@30 or slip@30"

_JOINTS: Final = (1, 2, 3)
_ADDITIVE: Final = tuple(f"{kind}{joint}" for kind in ("bias", "drift", "push") for joint in _JOINTS)
_SCALES: Final = tuple(f"scale{joint}" for joint in _JOINTS)
_SWITCH_KINDS: Final = ("freeze", "lock", "cut")
_SWITCHES: Final = tuple(f"{kind}{joint}" for kind in _SWITCH_KINDS for joint in _JOINTS)
_SLIP: Final = "slip"
_CUT_GRIPPER: Final = "cutgripper"
_GRIPPER: Final = 4
_PAYLOAD: Final = "payload"
PADS: Final = "pads"
_SUPPLY: Final = "supply"
_LATE: Final = "late"
_FACTORS: Final = (_PAYLOAD, PADS, _SUPPLY)
TARGETS: Final = (*PARAMETER_NAMES, *_FACTORS, *_ADDITIVE, *_SCALES, *_SWITCHES, _CUT_GRIPPER, _LATE, _SLIP)

_OPERATIONS: Final[dict[str, tuple[str, ...]]] = {
    **dict.fromkeys((*PARAMETER_NAMES, *_FACTORS), ("*=", "+=", "=")),
    **dict.fromkeys(_ADDITIVE, ("+=",)),
    **dict.fromkeys(_SCALES, ("*=",)),
    **dict.fromkeys((*_SWITCHES, _CUT_GRIPPER, _SLIP, _LATE), ()),
}
_NUMBER: Final = r"\d+(?:\.\d*)?(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?"
_PATTERN: Final = re.compile(
    rf"\s*(?P<target>[A-Za-z]+\d*)\s*(?:(?P<operation>\*=|\+=|=)\s*(?P<value>[+-]?(?:{_NUMBER})))?"
    rf"\s*@\s*(?P<start>{_NUMBER})\s*(?:-\s*(?P<end>{_NUMBER}))?\s*"
)
NEVER: Final = 2**62
"""Integration step at which nothing happens any more."""
_ROUNDING: Final = 1e-6
"""Tolerance of due times, in steps."""
MOST_FAULTS: Final = 64
"""Number of faults that a cell may have at a time or still before it."""
GREATEST: Final = 1e6
"""Greatest number in a fault, in the unit of its target: far more than what any arm survives."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One scheduled change.

    Attributes:
        target: one of TARGETS.
        operation: "*=", "+=" or "="; "" for the targets that take no number.
        value: the number; 0 for the targets that take none.
        start: plant time from which the fault holds, s.
        end: plant time from which it holds no longer, s; infinite by default.

    Raises:
        FaultError: the target is unknown or takes another operation, or a number or time is out of range.
    """

    target: str
    operation: str
    value: float
    start: float
    end: float = math.inf

    def __post_init__(self) -> None:
        if self.target not in _OPERATIONS:
            raise FaultError(f"unknown fault target {self.target!r}: expected {choices(TARGETS)}")
        operations = _OPERATIONS[self.target]
        if operations and self.operation not in operations:
            raise FaultError(f"fault {self.target}: expected {choices(operations)} NUMBER, got {self.operation!r}")
        if not operations and (self.operation or self.value):
            raise FaultError(f"fault {self.target}: takes no number, expected {self.target}@START")
        if not abs(self.value) <= GREATEST:
            raise FaultError(f"fault {self.target}: expected a number up to {GREATEST:g}, got {self.value}")
        if self.target in _SCALES and not self.value > 0:
            raise FaultError(f"fault {self.target}: expected a factor above 0, got {self.value}")
        if not 0 <= self.start <= LATEST:
            raise FaultError(f"fault {self.target}: expected a start from 0 to {LATEST:g} s, got {self.start}")
        if not self.end > self.start:
            raise FaultError(f"fault {self.target}: expected an end after its start {self.start} s, got {self.end}")
        if self.target == _SLIP and math.isfinite(self.end):
            raise FaultError("fault slip: happens at one moment, expected slip@START without an end")

    def over(self, time: float) -> bool:
        """Whether the fault changes nothing any more after a plant time (s)."""
        return self.end <= time or (self.target == _SLIP and self.start <= time)

    def __str__(self) -> str:
        change = f"{self.operation}{_plain(self.value)}" if self.operation else ""
        end = f"-{_plain(self.end)}" if math.isfinite(self.end) else ""
        return f"{self.target}{change}@{_plain(self.start)}{end}"


def parse_fault(text: str) -> Fault:
    """Reads one fault; the inverse of `str(fault)`.

    Raises:
        FaultError: the text does not follow the grammar of this module.
    """
    match = _PATTERN.fullmatch(text)
    if match is None:
        raise FaultError(f"fault {text!r}: expected {GRAMMAR}; targets are {choices(TARGETS)}")
    target, operation, value, start, end = match.groups()
    return Fault(target, operation or "", float(value or 0), float(start), float(end) if end else math.inf)


@dataclass(frozen=True, slots=True)
class Condition:
    """The effect of all faults that hold at one time.

    Attributes:
        parameters: parameters of the arm under the faults.
        payload_factor: factor of the mass of a held box.
        payload_offset: mass added to a held box after the factor, kg.
        encoders: faults of the encoders.
        locked: joints (1 to 3) that do not move.
        cut: joints (1 to 3, and 4 for the gripper) without voltage.
        pad_factor: factor of the friction between pads and boxes.
        pad_offset: friction added after the factor.
        supply: share of the commanded voltages that reaches joints 1 to 3.
        late: whether commands act one period later than they did.
        push: torques on joints 1 to 3 from outside, N m.
    """

    parameters: ArmParameters
    payload_factor: float = 1.0
    payload_offset: float = 0.0
    encoders: EncoderFaults = HEALTHY
    locked: frozenset[int] = frozenset()
    cut: frozenset[int] = frozenset()
    pad_factor: float = 1.0
    pad_offset: float = 0.0
    supply: float = 1.0
    late: bool = False
    push: CellJoints = every_joint(0.0)

    def pad_friction(self, healthy: float) -> float:
        """Coefficient of friction of the pads whose healthy one is given."""
        return self.pad_factor * healthy + self.pad_offset

    def arriving(self, volts: DriveVector) -> DriveVector:
        """Voltages that reach the motors of commanded ones, V."""
        if not self.cut and self.supply == 1.0:
            return volts
        v1, v2, v3 = (0.0 if i in self.cut else self.supply * volts[i - 1] for i in (1, 2, 3))
        return v1, v2, v3, 0.0 if _GRIPPER in self.cut else volts[3]

    def payload(self, mass: float) -> float:
        """Mass at the tip while a box of a mass (kg) is held, kg."""
        return self.payload_factor * mass + self.payload_offset


@dataclass(frozen=True, slots=True)
class ConditionChange:
    """A condition that holds from a plant time on.

    Attributes:
        time: plant time, s.
        condition: effect of all faults from then on.
        texts: which faults began and ended.
        slips: whether the held box is lost.
    """

    time: float
    condition: Condition
    texts: tuple[str, ...]
    slips: bool


def schedule(
    parameters: ArmParameters, faults: Iterable[Fault], lightest: float = BoxStream().lightest
) -> list[ConditionChange]:
    """All changes of the condition, in order of time.

    Args:
        parameters: parameters of the healthy arm.
        faults: all faults.
        lightest: mass of the lightest box, kg.

    Raises:
        FaultError: there are too many, or they make a parameter or the payload impossible at some time.
    """
    ordered = sorted(faults, key=lambda fault: fault.start)
    if len(ordered) > MOST_FAULTS:
        raise FaultError(f"faults: expected at most {MOST_FAULTS} that are not over yet, got {len(ordered)}")
    times = sorted({t for fault in ordered for t in (fault.start, fault.end) if math.isfinite(t)})
    transitions = []
    for time in times:
        began = [fault for fault in ordered if fault.start == time]
        ended = [fault for fault in ordered if fault.end == time]
        condition = _compose(parameters, [fault for fault in ordered if fault.start <= time < fault.end], lightest)
        texts = (*(f"{fault} ended" for fault in ended), *(f"{fault} began" for fault in began))
        transitions.append(ConditionChange(time, condition, texts, any(fault.target == _SLIP for fault in began)))
    return transitions


def due_step(time: float, step: float) -> int:
    """The integration step at which a change is due: one at 45 s happens at 45 s however the sum of steps is rounded.

    Args:
        time: when it is due, s.
        step: integration step, s.
    """
    return math.ceil(time / step - _ROUNDING)


class FaultSchedule:
    """The faults of a running cell, and when they change the condition of its arm.

    Args:
        healthy: parameters of the healthy arm.
        lightest: mass of the lightest box, kg.
        faults: the faults.
        step: integration step, s.

    Attributes:
        faults: those that are not over yet, and those that were at the beginning.

    Raises:
        FaultError: there are too many, or they make a parameter or the payload impossible at some time.
    """

    def __init__(self, healthy: ArmParameters, lightest: float, faults: tuple[Fault, ...], step: float) -> None:
        self._healthy, self._lightest, self._step = healthy, lightest, step
        self.faults = faults
        self._changes = schedule(healthy, faults, lightest)[::-1]

    @property
    def next_step(self) -> int:
        """The integration step at which the next change is due; NEVER without one."""
        return due_step(self._changes[-1].time, self._step) if self._changes else NEVER

    def take_due(self, steps: int) -> ConditionChange | None:
        """The next change, if it is due after so many integration steps; it is not due again."""
        return self._changes.pop() if self._changes and self.next_step <= steps else None

    def add(self, faults: tuple[Fault, ...], time: float, steps: int) -> tuple[Fault, ...]:
        """Adds faults; those that would begin in the past begin in the next integration step.

        Args:
            faults: the faults.
            time: plant time, s.
            steps: number of integration steps so far.

        Returns:
            The faults with the times at which they begin and end.

        Raises:
            FaultError: a fault has ended already, or the faults together make a parameter or the payload impossible.
        """
        earliest = round(time + self._step, 9)
        added = tuple(replace(fault, start=max(fault.start, earliest)) for fault in faults)
        standing = tuple(fault for fault in self.faults if not fault.over(time))
        changes = schedule(self._healthy, (*standing, *added), self._lightest)
        self.faults = (*standing, *added)
        self._changes = [change for change in changes if due_step(change.time, self._step) > steps][::-1]
        return added

    def restore(self, faults: tuple[Fault, ...], steps: int) -> Condition:
        """Goes on where a cell with these faults was after so many integration steps; the condition of its arm then.

        Raises:
            FaultError: the faults make a parameter or the payload impossible.
        """
        self.faults = faults
        changes = schedule(self._healthy, faults, self._lightest)
        passed = [change for change in changes if due_step(change.time, self._step) <= steps]
        self._changes = changes[len(passed) :][::-1]
        return passed[-1].condition if passed else Condition(self._healthy)


def _compose(parameters: ArmParameters, active: Sequence[Fault], lightest: float) -> Condition:
    shares = dict.fromkeys(_FACTORS, (1.0, 0.0))
    offset, rate, push = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    scale = [1.0, 1.0, 1.0]
    switched: dict[str, set[int]] = {kind: set() for kind in _SWITCH_KINDS}
    late = False
    for fault in active:
        if fault.target in PARAMETER_NAMES:
            parameters = _changed(parameters, fault)
        elif fault.target in _FACTORS:
            shares[fault.target] = _operate(fault, *shares[fault.target])
            _check_share(fault, *shares[fault.target], lightest)
        elif fault.target == _CUT_GRIPPER:
            switched["cut"].add(_GRIPPER)
        elif fault.target == _LATE:
            late = True
        elif fault.target != _SLIP:
            kind, i = fault.target[:-1], int(fault.target[-1]) - 1
            if kind == "bias":
                offset[i] += fault.value
            elif kind == "drift":
                offset[i] -= fault.value * fault.start
                rate[i] += fault.value
            elif kind == "scale":
                scale[i] *= fault.value
            elif kind == "push":
                push[i] += fault.value
            else:
                switched[kind].add(i + 1)
    return Condition(
        parameters,
        *shares[_PAYLOAD],
        EncoderFaults(
            (offset[0], offset[1], offset[2]),
            (rate[0], rate[1], rate[2]),
            frozenset(switched["freeze"]),
            (scale[0], scale[1], scale[2]),
        ),
        frozenset(switched["lock"]),
        frozenset(switched["cut"]),
        *shares[PADS],
        sum(shares[_SUPPLY]),
        late,
        (push[0], push[1], push[2]),
    )


def _check_share(fault: Fault, factor: float, extra: float, lightest: float) -> None:
    """Checks what a fault makes of a quantity; see `_operate`.

    Raises:
        FaultError: nothing can be like that.
    """
    if fault.target == _PAYLOAD and not 0 <= factor * lightest + extra <= GREATEST:
        raise FaultError(f"fault {fault}: expected a payload from 0 to {GREATEST:g} kg with a box of {lightest} kg")
    if fault.target == PADS and not (factor >= 0 and extra >= 0 and factor + extra <= GREATEST):
        raise FaultError(f"fault {fault}: expected a friction of the pads of at least 0")
    if fault.target == _SUPPLY and not 0 <= factor + extra <= 1:
        raise FaultError(f"fault {fault}: expected a share from 0 to 1, got {factor + extra:g}")


def _operate(fault: Fault, factor: float, extra: float) -> tuple[float, float]:
    """The factor and the offset of a quantity after a fault has changed factor x quantity + offset."""
    if fault.operation == "*=":
        return factor * fault.value, extra * fault.value
    if fault.operation == "+=":
        return factor, extra + fault.value
    return 0.0, fault.value


def _changed(parameters: ArmParameters, fault: Fault) -> ArmParameters:
    factor, extra = _operate(fault, 1.0, 0.0)
    try:
        return parameters.with_values({fault.target: factor * parameters.get(fault.target) + extra})
    except ParameterError as error:
        raise FaultError(f"fault {fault}: {error}") from None


def _plain(number: float) -> str:
    return repr(float(number)).removesuffix(".0")
