"""What consoles ask of the desk of a cell, from which one session at a time may command.

The rules of `dtwin.bus.messages` hold, which has the topic.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from dtwin.signals import SCHEMA, Word

DeskAction = Literal["occupy", "keep", "leave"]


class DeskRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What a session wants of the desk.

    Attributes:
        session: name of the session.
        user: name of the person.
        action: occupy takes the desk if it is free, keep is a sign of life of who has it, leave frees it.
    """

    session: Word
    user: Word
    action: DeskAction


class DeskState(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Who has the desk.

    Attributes:
        session: name of the session, "" when it is free.
        user: name of the person, "" when it is free.
        left: time without a sign of life after which it is free, s.
    """

    session: Word = ""
    user: Word = ""
    left: float = 0.0
