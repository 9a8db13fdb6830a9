"""Blocks that put bit strings together and take them apart, functions of 4diac IDE's library utils."""

from __future__ import annotations

import re
from typing import Final

from iec61499 import model
from iec61499.standard.notation import function
from iec61499.types import ELEMENTARY

_NAME: Final = re.compile(
    r"(?:ASSEMBLE_(?P<target>BYTE|WORD|DWORD|LWORD)_FROM|SPLIT_(?P<source>BYTE|WORD|DWORD|LWORD)_INTO)"
    r"_(?P<parts>BOOLS|QUARTERS|BYTES|WORDS)"
)
_PARTS: Final = {
    "BOOLS": ("BIT", "BOOL", 1),
    "QUARTERS": ("QUARTER_BYTE", "BYTE", 2),
    "BYTES": ("BYTE", "BYTE", 8),
    "WORDS": ("WORD", "WORD", 16),
}
"""How the ports of the parts are called, their type, and how many bits of the whole each has."""
PATTERNS: Final = ("ASSEMBLE_X_FROM_Y", "SPLIT_X_INTO_Y")


def assembling(name: str) -> model.SimpleFBType | None:
    """ASSEMBLE_BYTE_FROM_BOOLS, SPLIT_WORD_INTO_BYTES and the like; None when there is none of the name.

    The result of one that puts together is called as the block. The first part is the lowest.
    """
    match = _NAME.fullmatch(name)
    if match is None:
        return None
    whole = ELEMENTARY[match["target"] or match["source"]]
    port, kind, bits = _PARTS[match["parts"]]
    if bits >= whole.bits:
        return None
    parts = [f"{port}_{number:02}" for number in range(whole.bits // bits)]
    if match["target"]:
        statements = [f"{name} := {whole}#0;"]
        copies = [(f"{name}.%X{bit}", _bit(parts[bit // bits], bit % bits, kind)) for bit in range(whole.bits)]
        ports = f"{', '.join(parts)}: {kind} -> {name}: {whole}"
    else:
        statements = [f"{part} := {kind}#0;" for part in parts]
        copies = [(_bit(parts[bit // bits], bit % bits, kind), f"IN.%X{bit}") for bit in range(whole.bits)]
        ports = f"IN: {whole} -> {', '.join(parts)}: {kind}"
    text = "\n".join([*statements, *(f"{left} := {right};" for left, right in copies)])
    return function(name, "", ports, text)


def _bit(part: str, bit: int, kind: str) -> str:
    return part if kind == "BOOL" else f"{part}.%X{bit}"
