"""Reads function types (.fct) as 4diac IDE writes them: a FUNCTION of IEC 61131-3 as a block with REQ and CNF.

The text is a whole declaration. Its header and the variables of the interface, which the interface list has as well,
are blanked out; so what is left is an algorithm whose lines and columns are those of the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any, Final

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.files.names import ImportingNames, Names, absent_constants, used_constants
from iec61499.files.xml import XmlElement
from iec61499.literals import format_literal
from iec61499.types import ArrayType, StructType

RESULTS: Final = 1024
"""Most elementary values that the outputs of a function have together."""
_MASKED: Final = re.compile(r"""\(\*.*?\*\)|/\*.*?\*/|//[^\n]*|'(?:\$.|[^'$])*'|"(?:\$.|[^"$])*\"""", re.DOTALL)
"""Comments and texts, in which words mean nothing."""
_NAME: Final = r"[A-Za-z_]\w*(?:::[A-Za-z_]\w*)*"
_HEADER: Final = re.compile(
    rf"\bFUNCTION\s+{_NAME}(\s*:(?!=)\s*(ARRAY\s*\[[^\]]*\]\s*OF\s+)*{_NAME}(\s*\[[^\]]*\])?)?\s*;?", re.IGNORECASE
)
_END: Final = re.compile(r"\bEND_FUNCTION\b", re.IGNORECASE)
_PORTS: Final = re.compile(r"\bVAR_(?:INPUT|OUTPUT|IN_OUT)\b.*?\bEND_VAR\b", re.IGNORECASE | re.DOTALL)
_VARIABLES: Final = re.compile(r"\bEND_VAR\b", re.IGNORECASE)
_IMPORT: Final = re.compile(rf"\bIMPORT\s+({_NAME})\s*;", re.IGNORECASE)


class ForeignLanguageError(FunctionBlockError):
    """An algorithm in another language than Structured Text."""


def read_function(
    root: XmlElement, header: model.TypeHeader, interface: model.Interface, names: Names
) -> model.FBType:
    """The block that a function is.

    Its variables are new with every call, as IEC 61131-3, 6.6.2 has them: it begins with giving the outputs their
    initial values.

    Raises:
        FunctionBlockError: the body is no single function in Structured Text, or its events are not REQ and CNF.
    """
    body = root.child("FunctionBody")
    if body is None:
        return model.ServiceInterfaceFBType(header, interface)
    source = body.child("ST")
    if source is None:
        other = next(body.children(), None)
        language = other.tag if other is not None else "no language"
        message = f"function {header.name} in {language} is not supported: expected Structured Text (<ST>)"
        raise ForeignLanguageError(message, body.file, body.line)
    events = [event.name for event in (*interface.event_inputs, *interface.event_outputs)]
    if len(interface.event_inputs) != 1 or len(interface.event_outputs) != 1:
        raise root.error(f"function {header.name} has the events {', '.join(events) or 'none'}: expected REQ and CNF")
    written = [variable for variable in interface.outputs if variable.name not in interface.in_outs]
    resets = [line for v in written for line in _resets(v.name, v.type, model.initial_value(v, root.file))]
    if len(resets) > RESULTS:
        raise root.error(f"the outputs of function {header.name} have {len(resets)} values: expected up to {RESULTS}")
    text, imports = _algorithm(source, header.name, " ".join(resets))
    algorithm = model.Algorithm(header.name, model.Source(text, source.line, exact=True))
    state = model.ECState(events[0], (model.ECAction(header.name, events[1], body.line),), line=body.line)
    known, own = ImportingNames(names, imports, header.package), interface.names()
    constants, absent = used_constants([text], known, own), absent_constants([text], known, own)
    return model.SimpleFBType(header, interface, (), (state,), (algorithm,), constants, absent=absent)


def _algorithm(source: XmlElement, name: str, resets: str) -> tuple[str, list[str]]:
    """The function's own variables, the statements `resets` and its own, and what it imports."""
    text = source.text
    masked = _MASKED.sub(lambda match: _blank(match[0]), text)
    header = _HEADER.search(masked)
    end = _END.search(masked, header.end()) if header is not None else None
    if header is None or end is None or _HEADER.search(masked, end.end()) is not None:
        raise source.error(f"the text of {name} is not supported: expected one FUNCTION ... END_FUNCTION")
    ports = [match.span() for match in _PORTS.finditer(masked, header.end(), end.start())]
    for first, last in ((0, header.end()), *ports, (end.start(), len(text))):
        text = text[:first] + _blank(text[first:last]) + text[last:]
    statements = max([header.end(), *(v.end() for v in _VARIABLES.finditer(masked, header.end(), end.start()))])
    return f"{text[:statements]} {resets}{text[statements:]}", _IMPORT.findall(masked[: header.start()])


def _blank(text: str) -> str:
    return re.sub(r"[^\n]", " ", text)


def _resets(name: str, kind: model.VariableType, value: Any) -> Iterator[str]:
    """Assignments that give a variable a value, one for every elementary part."""
    if isinstance(kind, ArrayType):
        for index, item in enumerate(value, kind.lower):
            yield from _resets(f"{name}[{index}]", kind.element, item)
    elif isinstance(kind, StructType):
        for member, item in zip(kind.members, value, strict=True):
            yield from _resets(f"{name}.{member.name}", member.type, item)
    elif not isinstance(kind, model.GenericType):
        yield f"{name} := {format_literal(value, kind)};"
