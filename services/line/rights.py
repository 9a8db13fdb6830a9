"""Who may do what in a secured line: writes the configuration of its router and of everybody who joins it.

Used by `scripts/secured-line`. Every process of the line has a certificate of its own, as the twin of a zone is not
to speak for another one; so has every vehicle that somebody else drives.
"""

from __future__ import annotations

import json
import re
import sys
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import tyro

from dtwin.bus.line import topics as of_line
from dtwin.bus.messages import (
    EVENTS,
    FAULT,
    JOINT_COMMANDS,
    JOINT_SENSORS,
    JOINT_TICKS,
    PATH,
    SENSORS,
    SUMMARY,
    TICKS,
    TRUTH,
    VOLTAGES,
)
from dtwin.errors import ModelError
from dtwin.line.file import DEFAULT_NAME, line_of
from dtwin.line.line import Line
from dtwin.line.live.zone import OVERALL
from dtwin.names import check_name
from dtwin.parameters import ROOT
from dtwin.services.console import NAME as CONSOLE
from dtwin.services.line.plant import NAME as PLANT
from dtwin.services.line.zone import service_of
from dtwin.services.runfile import LINE, OPERATOR

SECURED: Final = ROOT / "config" / "secured"
"""Configuration of a secured cell, whose router and clients those of a line are like."""
_AIS: Final = ("ai-observe", "ai-propose", "ai-act")
_PEOPLE: Final = (CONSOLE, OPERATOR)
Action = Literal["publish", "announce", "answer", "ask"]
AT_LINE: Final[Mapping[str, tuple[str, tuple[str, ...]]]] = {
    of_line.PLANT_STATE.name: (PLANT, ()),
    of_line.PLANT_SET_UP.name: (PLANT, (OVERALL,)),
    of_line.PLANT_WORD.name: (PLANT, (OVERALL, CONSOLE)),
    of_line.LINE_STATE.name: (OVERALL, (*_PEOPLE, *_AIS)),
    of_line.LINE_PREDICT.name: (OVERALL, (*_PEOPLE, *_AIS)),
    of_line.LINE_LOOK.name: (OVERALL, (*_PEOPLE, *_AIS)),
    of_line.LINE_PROPOSE.name: (OVERALL, (OPERATOR, "ai-propose", "ai-act")),
    of_line.LINE_DECIDE.name: (OVERALL, _PEOPLE),
    of_line.SET_UP.name: (OVERALL, (*_PEOPLE, "ai-act")),
    of_line.LINE_STOP.name: (OVERALL, (*_PEOPLE, "ai-act")),
    of_line.LINE_SETTLE.name: (OVERALL, _PEOPLE),
    of_line.LINE_RELEASE.name: (OVERALL, _PEOPLE),
    of_line.LINE_PLAN.name: (OVERALL, _PEOPLE),
    of_line.LINE_DESK.name: (OVERALL, _PEOPLE),
    SUMMARY.name: (OPERATOR, (*_PEOPLE, *_AIS)),
}
"""Who publishes or answers a topic of the line, and who asks it."""
_ARM: Final = (SENSORS, VOLTAGES, PATH, TICKS, TRUTH, EVENTS, JOINT_SENSORS, JOINT_COMMANDS, JOINT_TICKS)
"""What the plant publishes of the arm of a station."""
_VEHICLE: Final = ("state", "connection", "factsheet")
"""What a vehicle that somebody else drives publishes."""
_WAYS: Final[Mapping[Action, tuple[tuple[tuple[str, ...], str], ...]]] = {
    "publish": ((("put",), "ingress"),),
    "announce": ((("put", "liveliness_token"), "ingress"),),
    "answer": ((("declare_queryable", "reply"), "ingress"), (("query",), "egress")),
    "ask": ((("query",), "ingress"),),
}
"""The messages that pass a router for each action, and whether it takes them or passes them on."""


class Right(NamedTuple):
    """What somebody may do with a key."""

    role: str
    action: Action
    key: str


def vehicle_role(name: str) -> str:
    """The role of a vehicle that somebody else drives."""
    return f"vehicle-{name}"


def roles(line: Line) -> list[str]:
    """The names of all certificates of a line but its router's."""
    vehicles = [vehicle_role(v.name) for zone in line.zones for v in zone.vehicles if v.manufacturer]
    return [PLANT, OVERALL, *(service_of(zone.name) for zone in line.zones), *_PEOPLE, *_AIS, *vehicles]


def rights(line: Line, name: str) -> Iterator[Right]:
    """All that anybody may do in a line of a name, beside watching it."""
    own, zones = f"dtwin/{name}/{LINE}", [service_of(zone.name) for zone in line.zones]
    for role in (PLANT, OVERALL, *zones, CONSOLE):
        yield from (Right(role, "announce", f"{own}/{each}") for each in (f"status/{role}", f"alive/{role}/**"))
    for role in (PLANT, OVERALL, *zones, CONSOLE, OPERATOR, "ai-act"):
        yield Right(role, "publish", f"{own}/{EVENTS.name}")
    for topic, (giver, askers) in AT_LINE.items():
        yield Right(giver, "publish" if topic == of_line.PLANT_STATE.name else "answer", f"{own}/{topic}")
        yield from (Right(role, "ask", f"{own}/{topic}") for role in askers)
    for zone in line.zones:
        key = f"dtwin/{name}/{zone.name}"
        yield Right(service_of(zone.name), "publish", f"{key}/{of_line.ZONE_STATE.name}")
        yield Right(service_of(zone.name), "answer", f"{key}/{of_line.ZONE_FLOW.name}")
        yield Right(OVERALL, "ask", f"{key}/{of_line.ZONE_FLOW.name}")
        for topic in (of_line.PLANT_SET_UP.name, of_line.PLANT_WORD.name, of_line.PLANT_NOW.name):
            yield Right(PLANT, "answer", f"{key}/{topic}")
            yield Right(service_of(zone.name), "ask", f"{key}/{topic}")
    for station in line.stations:
        key = f"dtwin/{name}/{station.name}"
        yield from (Right(PLANT, "publish", f"{key}/{topic.name}") for topic in _ARM)
        yield Right(PLANT, "answer", f"{key}/{FAULT.name}")
        yield from (Right(role, "ask", f"{key}/{FAULT.name}") for role in _PEOPLE)
    yield Right(PLANT, "publish", f"{own}/vda5050/**")
    for vehicle in (each for zone in line.zones for each in zone.vehicles if each.manufacturer):
        key = f"{own}/vda5050/v3/{vehicle.manufacturer}/{vehicle.name}"
        yield from (Right(vehicle_role(vehicle.name), "publish", f"{key}/{topic}") for topic in _VEHICLE)


def access_control(line: Line, name: str) -> dict[str, Any]:
    """The access control of the router of a line, as Zenoh's configuration has it."""
    everything = [f"dtwin/{name}/**"]
    told = ["put", "reply", "liveliness_token", "declare_subscriber", "declare_queryable"]
    watched = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
    rules = [_rule("watch", watched, "ingress", everything), _rule("receive", told, "egress", everything)]
    held: dict[tuple[str, Action], list[str]] = defaultdict(list)
    for right in rights(line, name):
        held[right.role, right.action].append(right.key)
    own: dict[str, list[str]] = {role: ["watch", "receive"] for role in roles(line)}
    for (role, action), keys in held.items():
        for number, (messages, flow) in enumerate(_WAYS[action], 1):
            rule = _rule(f"{action} {number} {role}", list(messages), flow, keys)
            rules.append(rule)
            own[role].append(rule["id"])
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": [{"id": role, "cert_common_names": [role]} for role in own],
        "policies": [{"rules": ids, "subjects": [role]} for role, ids in own.items()],
    }


def _rule(identity: str, messages: list[str], flow: str, keys: list[str]) -> dict[str, Any]:
    return {"id": identity, "messages": messages, "flows": [flow], "permission": "allow", "key_exprs": keys}


def write(folder: Path, line: Line, name: str) -> list[str]:
    """Writes the configuration of a line of a name into a folder; the names of the certificates that it needs.

    Raises:
        ModelError: a file cannot be written.
        ParameterError: it is no name.
    """
    check_name(name, "name")
    router = (SECURED / "router.json5").read_text()
    head = router[: router.index("  access_control:")]
    head = re.sub(r"// Paths .*?(?=\{)", "// Paths are relative to this file.\n", head, count=1, flags=re.DOTALL)
    rules = json.dumps(access_control(line, name), indent=2).replace("\n", "\n  ")
    client = (SECURED / f"{OPERATOR}.json5").read_text()
    files = {"router": f"{head}  access_control: {rules},\n}}\n"}
    for role in roles(line):
        files[role] = client.replace(f'"{OPERATOR}"', f'"{role}"').replace(f"/{OPERATOR}.", f"/{role}.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for each, text in files.items():
            (folder / f"{each}.json5").write_text(text)
    except OSError as error:
        raise ModelError(f"{error.filename}: {error.strerror}") from None
    return list(files)


@dataclass(frozen=True, kw_only=True)
class Options:
    """Write the configuration of a secured line, and print the names of the certificates that it needs."""

    folder: tyro.conf.Positional[Path]
    """Folder of the configuration."""
    line: str = DEFAULT_NAME
    """Line: a file (*.toml), or a name of the folder lines."""
    name: str = LINE
    """Name under which the line runs."""

    def run(self) -> int:
        print(*write(self.folder, line_of(self.line), self.name))
        return 0


if __name__ == "__main__":
    from dtwin.services.service import main

    sys.exit(main("line.rights", Options))
