"""What the monitor says: findings with cause, size and confidence, forecasts, and the verdict as it is published."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Final

import msgspec

from dtwin.bus.twin_messages import UNITS, MonitoredUnit, MonitoringVerdict, UnitState
from dtwin.monitoring.kinds import READ, RELATIVE, FaultId, parse_fault_id, reference

if TYPE_CHECKING:  # the monitor of another arm says what it finds in the same words, without this estimator
    from dtwin.monitoring.estimation.arrays import Change
    from dtwin.monitoring.estimation.estimator import Estimator

_TAKES_AWAY: Final = ("loss", "stop", "hold")
"""hypotheses of what leaves nothing to be changed: a joint without a motor, an encoder, or motion"""

_TOLD: Final = re.compile(r"confidence (\d+) %.* since (-?[\d.]+) s")
"""what a line about a finding tells of its confidence and time"""
OWN: Final = 0.4
"""most probability of a cause that is found before the arm is understood again: second faults so soon are rare, and
nothing is refitted from what is less probable than not"""


class Finding(msgspec.Struct, frozen=True):
    """One cause that explains what is wrong.

    Attributes:
        parameter: what changed, in the notation of faults: K2, D1, mu1, payload, bias3, drift3, freeze1, lock2, cut2,
            slip, unknown2.
        cause: the same in words.
        joint: 1 to 3, 0 for the gripper.
        size: size of the change in the unit of its kind, see `Kind.unit`; 0 where there is none to tell.
        deviation: standard deviation of the size.
        confidence: probability of this cause among all that were considered.
        since: plant time at which it began, s.
        detected: plant time at which it was noticed, s.
        settled: whether the diagnosis is complete; until then cause and size may still change.
        others: what else it may be, in the same notation, most likely first: with these the probability is 95 %.
        follows: the finding before it of which it may be a consequence, in the same notation; "" for none.
    """

    parameter: str
    cause: str
    joint: int
    size: float
    deviation: float
    confidence: float
    since: float
    detected: float
    settled: bool
    others: tuple[str, ...] = ()
    follows: str = ""

    @property
    def fault(self) -> FaultId:
        """What changed, as kind and joint."""
        return parse_fault_id(self.parameter)

    @property
    def failure(self) -> float:
        """Probability that something has failed: of a complete diagnosis only the cause is in doubt."""
        return 1.0 if self.settled and self.confidence else self.confidence

    def text(self) -> str:
        """One line for people."""
        unit, amount = self.fault.about.unit, ""
        if unit == RELATIVE:
            amount = f", {100 * self.size:+.1f} % +- {100 * self.deviation:.1f} %"
        elif unit is not None:
            # Angles are told in mrad wherever they are small.
            scale, told = (1e3, f"m{unit}") if unit.startswith("rad") else (1.0, unit)
            amount = f", {scale * self.size:+.3g} +- {scale * self.deviation:.1g} {told}"
        where = f" of joint {self.joint}" if self.joint else ""
        instead = "".join(f" or {parse_fault_id(each).where}" for each in self.others)
        if self.follows:
            instead += f" or a consequence of {parse_fault_id(self.follows).where}"
        sure = f"confidence {100 * self.confidence:.0f} %{instead and ','}{instead}"
        return f"{self.cause}{where}{amount}, {sure}, since {self.since:.2f} s"


def told(text: str) -> tuple[float, float]:
    """Confidence of a finding and the plant time at which it began, s, by the line in which `Finding.text` tells it.

    Where the line tells none, there is no confidence, and no number for the time.
    """
    found = _TOLD.search(text)
    return (float(found[1]) / 100.0, float(found[2])) if found else (0.0, math.nan)


def beside(first: Finding, other: Finding) -> Finding:
    """Another finding of the diagnosis of a first one: what else a joint shows whose motor, encoder or motion was
    taken away may be a consequence of that."""
    if first.joint != other.joint or first.fault.about.hypothesis not in _TAKES_AWAY:
        return other
    return msgspec.structs.replace(other, confidence=min(other.confidence, OWN), follows=first.parameter)


def finding(
    fault: FaultId,
    since: float,
    detected: float,
    size: float = 0.0,
    deviation: float = 0.0,
    confidence: float = 1.0,
    settled: bool = True,
    others: tuple[str, ...] = (),
) -> Finding:
    """The finding of a fault, with the fields of `Finding`."""
    return Finding(
        str(fault), fault.about.cause, fault.joint, size, deviation, confidence, since, detected, settled, others
    )


class Forecast(msgspec.Struct, frozen=True):
    """A parameter on its way to a limit.

    Attributes:
        parameter: name of the parameter, such as K2, D1 or bias3.
        cause: the change in words.
        joint: 1 to 3.
        change: change so far, relative to the model or in the unit of the kind, as its `Limit` says.
        per_hour: rate of the change.
        limit: change that must not be passed.
        hours: time from the last entry until it is; 0 if it has been.
        earliest, latest: 95 % interval of the hours; latest is infinite if the slope may be zero.
    """

    parameter: str
    cause: str
    joint: int
    change: float
    per_hour: float
    limit: float
    hours: float
    earliest: float
    latest: float

    def text(self) -> str:
        """One line for people."""
        about = parse_fault_id(self.parameter).about
        relative = about.limit is not None and about.limit.relative
        scale, unit, digits = (100.0, "%", 1) if relative else (1e3, f"m{about.unit}", 2)
        amount = f"{scale * self.change:+.{digits}f} {unit}"
        slope = f"{scale * self.per_hour:+.2g} {unit}/h"
        limit = f"{scale * self.limit:+.0f} {unit}"
        each, of = (1.0, "h") if self.hours >= 1.0 else (60.0, "min")
        times = [f"{each * time:.{1 if of == 'h' else 0}f}" for time in (self.hours, self.earliest, self.latest)]
        end = "is reached" if not self.hours else f"in {times[0]} {of} ({times[1]} to {times[2]} {of})"
        return f"{self.cause} of joint {self.joint} is {amount} and changes by {slope}: limit {limit} {end}"


def units_of(fault: FaultId) -> tuple[str, ...]:
    """The names in UNITS of what a fault befalls: a joint, all of them, or the gripper."""
    return UNITS[:-1] if fault.about.on_arm else (UNITS[fault.joint - 1],)


def verdict_on(
    time: float,
    suspected: FaultId | None,
    forecasts: Sequence[Forecast],
    findings: Sequence[Finding],
    misfit: Mapping[int, str],
    unobservable: tuple[str, ...],
    missed: int,
    restarts: int,
) -> MonitoringVerdict:
    """A verdict as it is published.

    Args:
        time: plant time, s.
        suspected: what may be wrong.
        forecasts: slow changes.
        findings: what is wrong.
        misfit: what there is to say of joints that the model does not fit, see `unfit_units`.
        unobservable, missed, restarts: as in `MonitoringVerdict`.
    """
    if misfit:
        failed = {unit for each in findings for unit in units_of(each.fault)}
        told = monitored_units(unit_states(None, (), findings), findings)
        units = unfit_units(misfit) | {unit: told[unit] for unit in failed}
    else:
        units = monitored_units(unit_states(suspected, forecasts, findings), findings)
    texts = tuple(forecast.text() for forecast in forecasts)
    found = tuple(map(monitored, gravest_first(findings)))
    return MonitoringVerdict(time, units, texts, unobservable, missed, restarts, found)


def unit_states(
    suspected: FaultId | None, forecasts: Iterable[Forecast], findings: Iterable[Finding]
) -> dict[str, UnitState]:
    """The gravest state of each of UNITS, given what may be wrong, slow changes, and what is wrong."""
    states: dict[str, UnitState] = dict.fromkeys(UNITS, "nominal")
    if suspected is not None:
        states.update(dict.fromkeys(units_of(suspected), "may be degrading"))
    for forecast in forecasts:
        states[UNITS[forecast.joint - 1]] = "may be degrading" if forecast.hours else "failed"
    for each in findings:
        states.update(dict.fromkeys(units_of(each.fault), "failed"))
    return states


def monitored_units(states: Mapping[str, UnitState], findings: Iterable[Finding]) -> dict[str, MonitoredUnit]:
    """The units as they are published: states by UNITS, and of several findings on a unit the gravest."""
    units = {unit: MonitoredUnit(state) for unit, state in states.items()}
    for found in reversed(gravest_first(findings)):
        units |= {unit: monitored(found, states[unit]) for unit in units_of(found.fault)}
    return units


def gravest_first(findings: Iterable[Finding]) -> list[Finding]:
    """Findings by how grave they are, of equals the last one first.

    One that an encoder itself tells goes before the others: it is the cause of what else is found there. So does one
    that takes the motor, the encoder or the motion of a joint away, since what only changes counts for less then.
    """
    told = sorted(findings, key=lambda each: (each.fault.kind in READ, each.fault.about.hypothesis in _TAKES_AWAY))
    return told[::-1]


def monitored(found: Finding, state: UnitState = "failed") -> MonitoredUnit:
    """A finding as it is published."""
    return MonitoredUnit(
        state,
        found.cause,
        found.parameter,
        found.size,
        found.deviation,
        found.confidence,
        found.since,
        found.detected,
        found.settled,
        found.text(),
        follows=found.follows,
    )


def size_of(state: FaultId, change: Change, estimator: Estimator) -> tuple[float, float]:
    """The size of a change of a state, and its standard deviation, in the unit of a finding."""
    unit = reference(str(state), estimator.belief.arm) if state.about.unit == RELATIVE else 1.0
    return (change.value - change.before) / unit, change.deviation / unit


def unfit_units(misfit: Mapping[int, str]) -> dict[str, MonitoredUnit]:
    """The units as they are published while the model does not fit the arm: what there is to say by joint, 1 to 3.

    There are none if there is nothing to say.
    """
    if not misfit:
        return {}
    return {
        unit: MonitoredUnit("not commissioned", text=misfit.get(number, "")) for number, unit in enumerate(UNITS, 1)
    }
