"""What the monitor says: a state a joint and the gripper, and findings with cause, size and confidence."""

from __future__ import annotations

from typing import Final, Literal

import msgspec

from dtwin.signals import ArmState

State = Literal["nominal", "may be degrading", "failed"]
Cause = Literal[
    "voltage constant",
    "friction",
    "payload differs",
    "gripper slip",
    "encoder bias",
    "encoder drift",
    "encoder freeze",
    "locked joint",
    "voltage not arriving",
    "unknown",
]
UNITS: Final = ("joint 1", "joint 2", "joint 3", "gripper")
"""what has a state of its own"""
CAUSE_OF: Final[dict[str, Cause]] = {
    "K": "voltage constant",
    "D": "friction",
    "mu": "friction",
    "friction": "friction",
    "payload": "payload differs",
    "slip": "gripper slip",
    "bias": "encoder bias",
    "drift": "encoder drift",
    "freeze": "encoder freeze",
    "lock": "locked joint",
    "cut": "voltage not arriving",
    "unknown": "unknown",
}
MISLEADING: Final[tuple[Cause, ...]] = ("encoder freeze", "encoder drift")
"""after which an arm that seems to stand need not stand"""
UNIT_OF: Final = {"K": "", "D": "N m s/rad", "mu": "N m", "payload": "kg", "bias": "rad", "drift": "rad/s"}
"""of a finding's size; a voltage constant's is relative; what is not listed has no size"""


class Finding(msgspec.Struct, frozen=True):
    """One cause that explains what is wrong.

    Attributes:
        parameter: what changed, in the notation of faults: K2, D1, mu1, payload, bias3, drift3, freeze1, lock2, cut2,
            slip, unknown2.
        cause: the same in words.
        joint: 1 to 3, 0 for the gripper.
        size: of the change, see UNIT_OF; 0 where there is none to tell.
        deviation: standard deviation of the size.
        confidence: probability of this cause among all that were considered.
        since: plant time at which it began, s.
        detected: plant time at which it was noticed, s.
        settled: whether the diagnosis is complete; until then cause and size may still change.
    """

    parameter: str
    cause: Cause
    joint: int
    size: float
    deviation: float
    confidence: float
    since: float
    detected: float
    settled: bool

    def text(self) -> str:
        """One line for people."""
        unit = UNIT_OF.get(self.parameter.rstrip("123"))
        amount = ""
        if unit == "":
            amount = f", {100 * self.size:+.1f} % +- {100 * self.deviation:.1f} %"
        elif unit is not None:
            amount = f", {self.size:+.3g} +- {self.deviation:.1g} {unit}"
        where = f" of joint {self.joint}" if self.joint else ""
        return f"{self.cause}{where}{amount}, confidence {100 * self.confidence:.0f} %, since {self.since:.2f} s"


def arm_state(finding: Finding) -> ArmState:
    """What a settled finding means to the function blocks' safe stop."""
    return "angles unknown" if finding.cause in MISLEADING else "failed"


class Forecast(msgspec.Struct, frozen=True):
    """A parameter on its way to a limit.

    Attributes:
        parameter: K2, D1, bias3, ...
        cause: of the change, in words.
        joint: 1 to 3.
        change: so far, of K and D relative to the model, of an encoder's offset in rad.
        per_hour: of the change.
        limit: that the change must not pass.
        hours: until it does, from the last entry; 0 if it has.
        earliest, latest: 95 % interval of the hours; latest is infinite if the slope may be zero.
    """

    parameter: str
    cause: Cause
    joint: int
    change: float
    per_hour: float
    limit: float
    hours: float
    earliest: float
    latest: float

    def text(self) -> str:
        """One line for people."""
        relative = self.parameter[0] in "KD"
        amount = f"{100 * self.change:+.1f} %" if relative else f"{1e3 * self.change:+.2f} mrad"
        slope = f"{100 * self.per_hour:+.2g} %/h" if relative else f"{1e3 * self.per_hour:+.2g} mrad/h"
        limit = f"{100 * self.limit:+.0f} %" if relative else f"{1e3 * self.limit:+.0f} mrad"
        end = (
            "is reached" if not self.hours else f"in {self.hours:.1f} h ({self.earliest:.1f} to {self.latest:.1f} h)"
        )
        return f"{self.cause} of joint {self.joint} is {amount} and changes by {slope}: limit {limit} {end}"


class Verdict(msgspec.Struct, frozen=True):
    """The monitor's opinion at a plant time (s).

    Attributes:
        states: by UNITS.
        findings: what is wrong now, first come first.
        forecasts: slow changes that will reach a limit, soonest first.
        unobservable: causes (with joint) that the last seconds could not have shown, such as friction of a joint
            that stood still.
        missed: samples that did not arrive since the start.
    """

    time: float
    states: dict[str, State]
    findings: tuple[Finding, ...]
    forecasts: tuple[Forecast, ...]
    unobservable: tuple[str, ...]
    missed: int


def unit_of(joint: int) -> str:
    """The name in UNITS of a joint (1 to 3) or the gripper (0)."""
    return UNITS[joint - 1] if joint else UNITS[3]


def joint_of(parameter: str) -> int:
    """1 to 3, 0 for the gripper's."""
    return int(parameter[-1]) if parameter[-1] in "123" else 0
