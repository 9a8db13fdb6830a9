"""Text from the plant is data: it is cut, made visible, and stands under a key that says where it comes from."""

from __future__ import annotations

import re
from typing import Any, Final, get_args

import msgspec

from dtwin.bus.messages import State
from dtwin.bus.proposals.messages import Kind, ProposalState
from dtwin.bus.twin_messages import UNITS, IdentificationPhase, UnitState
from dtwin.line.twins.ability import Ability
from dtwin.line.twins.decisions import Mode
from dtwin.monitoring.kinds import KINDS
from dtwin.parameters import PARAMETER_NAMES, Law
from dtwin.recovery.answers import MEASURES
from dtwin.signals import MONITOR, STOPS, EventKind
from dtwin.simulation.proposals.book import TWIN
from dtwin.terminal import printable

KEY: Final = "text_from_plant"
"""Key of every text that the server has not written itself."""
LONGEST: Final = 200
"""Greatest length of such a text, characters."""
MOST: Final = 100
"""Greatest number of items of a list, and of entries of an object, in an answer."""
CUT: Final = "…"
_JOINTED: Final = "|".join(sorted(KINDS))
_PARAMETER: Final = re.compile(rf"(?:{_JOINTED})[123]?(?: (?:and|or) (?:{_JOINTED})[123]?)*")
_HASH: Final = re.compile("[0-9a-f]{32}")
_SERVICES: Final = (
    *("emulator", "bridge", "controller", "recorder", "identification", "monitoring", "simulation", "console"),
    *("supervisor", "operator", "dtwin"),
)
_LINE: Final = (
    *("waits", "works", "stopped", "blocked", "home", "empty", "loaded", "charges", "finding", "set-up", "proposal"),
    *("none possible", "no finding", "no answer", "answers again", "repair", "overall twin", TWIN),
    *(*get_args(Ability), *get_args(Mode)),
)
WORDS: Final = frozenset(
    {
        *("", "gone", "dead", "silent", "start", "upload", "refuse", "confirm", "roll back", "blue", "red", "green"),
        *("gains", "target", "model", "payload", "offset", "pickup"),
        *get_args(State),
        *get_args(Kind),
        *get_args(ProposalState),
        *get_args(UnitState),
        *get_args(IdentificationPhase),
        *get_args(Law),
        *UNITS,
        *STOPS,
        *MEASURES,
        *PARAMETER_NAMES,
        *EventKind,
        *(MONITOR + kind for kind in EventKind),
        *(kind.cause for kind in KINDS.values()),
        *_SERVICES,
        *_LINE,
    }
)
"""Words of the project's own vocabulary, which say nothing but what they are: they need no mark."""


def cut(text: str) -> str:
    """A text in one visible line of bounded length."""
    shown = printable(text)
    return shown if len(shown) <= LONGEST else shown[: LONGEST - 1] + CUT


def from_plant(text: str) -> dict[str, str]:
    """A text of others as data, whatever it says."""
    return {KEY: cut(text)}


def is_own(text: str) -> bool:
    """Whether a text is a word of the project's vocabulary or the name of a fault."""
    return text in WORDS or _HASH.fullmatch(text) is not None or _PARAMETER.fullmatch(text) is not None


def marked(value: Any) -> Any:
    """What others have said, as an answer: every text that is none of the project's own words is marked and cut.

    Args:
        value: a message, or plain objects, lists, texts and numbers.

    Returns:
        plain objects, lists, texts and numbers. An object whose keys are texts of others becomes a list of its
        entries, each with its name marked. Lists are cut to their last MOST items; numbers have six digits.
    """
    plain = value if isinstance(value, dict | list | str | float | int | None) else msgspec.to_builtins(value)
    if isinstance(plain, str):
        return plain if is_own(plain) else from_plant(plain)
    if isinstance(plain, float):
        return float(f"{plain:.6g}")
    if isinstance(plain, list | tuple):
        return [marked(each) for each in plain[-MOST:]]
    if isinstance(plain, dict):
        return _object(plain)
    return plain


def _object(entries: dict[str, Any]) -> Any:
    if all(_is_field(name) for name in entries):
        return {name: marked(each) for name, each in entries.items()}
    some = list(entries.items())[:MOST]
    return [{"name": marked(name), "value": marked(each)} for name, each in some]


def _is_field(name: str) -> bool:
    """Whether a key is a field of a message, or one of the project's own words."""
    return name in FIELDS or is_own(name)


def _fields() -> frozenset[str]:
    """The names of all fields of what is said on the bus and kept in files."""
    from dtwin.bus import messages, twin_messages
    from dtwin.bus.line import messages as line
    from dtwin.bus.proposals import messages as proposals
    from dtwin.console.alarms import journal, states
    from dtwin.simulation import history

    kinds = (
        kind
        for module in (messages, twin_messages, line, proposals, journal, states, history)
        for kind in vars(module).values()
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct)
    )
    found = {field for kind in kinds for field in kind.__struct_fields__}
    return frozenset(
        found
        | {
            "schema",
            "kp",
            "ki",
            "kd",
            "voltage_constant",
            "mass",
            "inertia",
            "length",
            "com",
            "damping",
            "coulomb",
            "friction",
        }
    )


FIELDS: Final = _fields()
