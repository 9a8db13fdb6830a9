"""What is abnormal in a cell, and what its arm does, from what its services say."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from dtwin.bus.twin_messages import IdentificationState, MonitoringVerdict, Upload
from dtwin.bus.verdicts.opinion import is_known
from dtwin.console.telling import Condition, Health
from dtwin.signals import EventKind, Stop

STALE: Final = 1.0
"""Age from which on a value counts as stale, s."""
GOOD: Final = frozenset({"running", "waiting", "starting", "stopped", "off"})
"""States of a service that are no condition of their own; a stop has one already."""
NEWS: Final = frozenset(
    {
        *(
            EventKind.OPERATOR,
            EventKind.RECOVERY,
            EventKind.STOP,
            EventKind.UPLOAD,
            EventKind.CONFIRM,
            EventKind.ROLL_BACK,
        ),
        EventKind.PROPOSAL,
    }
)
"""Events after which what is not published may be another."""
_MEANING: Final[Mapping[Stop, str]] = {
    "none": "",
    "braking": "the arm brakes for a stop",
    "standstill": "the arm is stopped and held where it is",
    "torque off": "the arm is stopped, its motors have no voltage",
}


def conditions(
    services: Mapping[str, Health],
    stop: Stop,
    verdict: MonitoringVerdict | None,
    settings: Upload | None,
    age: float | None,
    watched: bool = True,
    proposed: int = 0,
) -> tuple[Condition, ...]:
    """The abnormal conditions of a cell, the severe ones first.

    Args:
        services: health of the services by name.
        stop: safe stop in force.
        verdict: last word of the monitor.
        settings: settings in force.
        age: time since the last sample, s; None before the first one.
        watched: whether the monitor, if there is one, watches the arm.
        proposed: number of proposals that wait for a person.
    """
    found = [*_found(services, stop, verdict, settings, age)]
    if not watched:
        found.append(Condition("unwatched", "service", "the monitor is stopped"))
    if proposed:
        several = f"{proposed} proposals wait" if proposed > 1 else "a proposal waits"
        found.append(Condition("proposal", "trial", f"{several} for a person: look at Simulation"))
    return tuple(sorted(found, key=lambda found: not found.severe))


def _found(
    services: Mapping[str, Health],
    stop: Stop,
    verdict: MonitoringVerdict | None,
    settings: Upload | None,
    age: float | None,
) -> Iterator[Condition]:
    if age is None or age > STALE:
        yield Condition("stale", "stale", "no samples of the arm arrive", True)
    if stop != "none":
        yield Condition("stop", "stop", _MEANING[stop], True)
    for name, health in services.items():
        if health.state not in GOOD:
            reason = f": {health.reason}" if health.reason else ""
            yield Condition(f"service {name}", "service", f"{name} is {health.state}{reason}", True)
    if verdict is not None and not is_known(verdict):
        yield Condition("silent", "service", "whether the arm is nominal is not known: the monitor is silent", True)
        verdict = None
    for name, unit in ({} if verdict is None else verdict.units).items():
        if unit.state != "nominal":
            # Confidence and time stand with the finding itself: the line of all that is abnormal is short.
            text = f"{name} {unit.state}" + (f": {unit.text.partition(', confidence')[0]}" if unit.text else "")
            yield Condition(f"finding {name}", "finding", text, unit.state == "failed")
    if settings is not None and settings.on_trial:
        yield Condition("trial", "trial", f"version {settings.version} of the settings is on trial")


def doing(
    stop: Stop, states: Iterable[str], identification: IdentificationState | None, held: str, waiting: str
) -> str:
    """What the arm does, in one line.

    Args:
        stop: safe stop in force.
        states: states of the services.
        identification: state of the identification.
        held: colour of the box in the gripper, "" for none.
        waiting: colour of the box that waits, "" for none.
    """
    if stop != "none":
        return _MEANING[stop]
    if "safe" in states:
        return "the arm has no voltage: commands stay away"
    if identification is not None and identification.phase == "measuring" and identification.of:
        return f"{identification.text}: {identification.samples} of {identification.of} samples"
    if held:
        return f"the arm carries a {held} box to its place"
    return f"the arm fetches a {waiting} box" if waiting else "the arm waits for a box"
