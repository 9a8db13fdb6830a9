"""What is abnormal in a line, from what it says of itself; what of it is an alarm, and what to do then."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from dtwin.bus.line.messages import LineState, StationSeen
from dtwin.console.alarms.sources import Row
from dtwin.console.conditions import GOOD
from dtwin.console.line.plant import UNKNOWN
from dtwin.console.telling import Condition, Health, Kind

CONSOLE: Final = "console"
"""Name of the service that a page is of: another one that has gone is nothing abnormal of the line."""
LOW: Final = 20.0
"""Charge of a battery that is low, percent."""
QUEUE: Final = 3
"""Number of boxes in front of the source from which on they are told."""
ROWS: Final[dict[Kind, Row]] = {
    "stale": Row("high", "nobody knows what the line does", "see whether `dtwin line up` runs, and to the network"),
    "stop": Row("high", "the work of the station is not done", "find the cause, make the arm safe, then release it"),
    "finding": Row("medium", "the line gets slower", "see the station; look at what the twins propose"),
    "service": Row("medium", "part of the line waits", "see to what is named"),
    "trial": Row("low", "what the twins found waits", "look at the proposal, and approve or decline it"),
}
"""By kind of condition: how urgent it is, what follows, and what to do."""


def conditions(
    state: LineState | None, services: Mapping[str, Health], lost: str, proposed: int, by_plant: bool = False
) -> tuple[Condition, ...]:
    """The abnormal conditions of a line, the severe ones first.

    Args:
        state: how it does; None before it has told.
        services: health of its processes by name.
        lost: why nothing is heard of it, or of its twin, "" while it is.
        proposed: number of proposals that wait for a person.
        by_plant: whether its plant is heard, and its twin is not.
    """
    found = [Condition("twin", "service", lost, True) if by_plant else Condition("stale", "stale", lost, True)]
    found = found if lost else []
    for name, health in services.items():
        if health.state not in GOOD and name != CONSOLE:
            reason = f": {health.reason}" if health.reason else ""
            found.append(Condition(f"service {name}", "service", f"{name} is {health.state}{reason}", True))
    if state is not None:
        found += _of_line(state)
        for station in state.stations:
            found += _of_station(station)
    if proposed:
        several = f"{proposed} proposals wait" if proposed > 1 else "a proposal waits"
        found.append(Condition("proposal", "trial", f"{several} for a person: look at Line"))
    return tuple(sorted(found, key=lambda found: not found.severe))


def _of_station(station: StationSeen) -> Iterator[Condition]:
    if station.doing == "stopped":
        yield Condition(f"station {station.name}", "stop", f"{station.name}: the arm is stopped", True)
    elif station.ability not in ("all", UNKNOWN):
        text = f"{station.name} can do {station.ability}: {station.why}"
        yield Condition(f"station {station.name}", "finding", text)


def _of_line(state: LineState) -> Iterator[Condition]:
    if state.lost:
        yield Condition("lost boxes", "stop", f"boxes lost: {state.lost}", True)
    if state.collisions:
        yield Condition("collisions", "stop", f"vehicles have touched: {state.collisions}", True)
    for decision in reversed(state.decisions):
        if decision.what in ("no answer", "answers again"):
            if decision.what == "no answer":
                yield Condition("control", "service", decision.why, True)
            break
    if state.outside >= QUEUE:
        yield Condition("queue", "finding", f"{state.outside} boxes wait in front of the source")
    for vehicle in state.vehicles:
        if vehicle.battery < LOW:
            yield Condition(
                f"vehicle {vehicle.name}", "service", f"{vehicle.name}: battery at {vehicle.battery:.0f} %"
            )
