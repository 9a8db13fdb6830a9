"""Files of other tools that look like library elements of IEC 61499-2 and are none, told by what they begin with."""

from __future__ import annotations

import re
from typing import Final

_NAMESPACES: Final = (
    (
        re.compile(r"se\.com/LibraryElements|nxtcontrol\.com", re.IGNORECASE),
        "a file of EcoStruxure Automation Expert or nxtStudio",
        "an export in the XML of IEC 61499-2, without a namespace",
    ),
    (
        re.compile(r"plcopen\.org|TC65SC65BWG7TF10"),
        "PLCopen XML of IEC 61131-10, which has programs and no function-block networks with events",
        "a library element of IEC 61499-2",
    ),
    (
        re.compile("fordiac", re.IGNORECASE),
        "a model of 4diac IDE 1.x (EMF)",
        "the .sys or .fbt file that 4diac IDE 1.9 or later writes after importing the project",
    ),
)
_JAVA: Final = re.compile(
    rb"\s*(?:/\*(?:[^*]|\*(?!/))*\*/\s*|//[^\n]*\n\s*)*(?:package|import|public\s+class|class)\s+[A-Za-z_]"
)
"""Comments, then a declaration of Java; no text is matched in two ways."""
_BEGINNING: Final = 4096
"""Bytes of a file that tell what it is."""


def dialect_of_namespace(namespace: str) -> str:
    """What a file is whose root element has that XML namespace, and what is expected; "" for an unknown one."""
    for pattern, what, expected in _NAMESPACES:
        if pattern.search(namespace):
            return f"is {what}: expected {expected}"
    return ""


def dialect_of_text(data: bytes) -> str:
    """What a file is that is no XML, and what is expected; "" for an unknown one."""
    if _JAVA.match(data[:_BEGINNING]):
        return "is a type in Java, as FBDK compiles it: expected the .fbt file in XML that it was made from"
    return ""
