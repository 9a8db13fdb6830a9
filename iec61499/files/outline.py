"""What a file says, line by line, without coordinates: for reading, for comparing, and as the text view of git."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from iec61499.files.xml import XmlElement, read_xml

SUFFIXES: Final = (".fbt", ".fct", ".sub", ".adp", ".dtp", ".gcf", ".sys")
"""Files that have an outline."""
_PORTS: Final = {
    "EventInputs": "event input",
    "EventOutputs": "event output",
    "SubAppEventInputs": "event input",
    "SubAppEventOutputs": "event output",
    "InputVars": "input",
    "OutputVars": "output",
    "InOutVars": "in-out",
    "InputInOutVars": "in-out",
    "OutputInOutVars": "in-out of output",
    "InternalVars": "variable",
    "InternalConstVars": "constant",
    "GlobalConstants": "constant",
    "Plugs": "plug",
    "Sockets": "socket",
}
_CONNECTIONS: Final = {
    "EventConnections": "event",
    "DataConnections": "data",
    "AdapterConnections": "adapter",
}
_ORDERED: Final = {"transition ": "transitions", "event ": "events and their connections"}
"""What takes place in the order in which it is declared, by the beginning of its name."""
_DRAWN: Final = frozenset({"x", "y", "dx1", "dx2", "dy", "width", "height"})
_PASSED_THROUGH: Final = frozenset(
    {"InterfaceList", "SubAppInterfaceList", "BasicFB", "SimpleFB", "ECC", "FBNetwork", "SubAppNetwork", "Service"}
    | {"StructuredType", "FunctionBody"}
)


@dataclass(frozen=True, slots=True)
class Item:
    """Something that a file declares: what it is, and what is said of it, which may have several lines."""

    name: str
    value: str = ""

    def lines(self) -> list[str]:
        """The item as it is printed."""
        if "\n" in self.value:
            return [self.name, *(f"    {line}".rstrip() for line in self.value.split("\n"))]
        return [f"{self.name}: {self.value}" if self.value else self.name]


def outline(file: Path) -> tuple[Item, ...]:
    """What a file says. Raises FunctionBlockError for a file that is no XML."""
    root = read_xml(file)
    counts: Counter[str] = Counter()
    made = []
    for item in (Item(f"{root.tag} {root.get('Name')}", _comment(root)), *_inside(root, "")):
        counts[item.name] += 1
        made.append(Item(f"{item.name} ({counts[item.name]})", item.value) if counts[item.name] > 1 else item)
    return tuple(made)


def difference(before: tuple[Item, ...], after: tuple[Item, ...]) -> list[str]:
    """Lines for what differs: `-` was there, `+` is there now, `~` says something else; of code the lines."""
    old = {item.name: item for item in before}
    new = {item.name: item for item in after}
    lines = []
    for name in dict.fromkeys((*old, *new)):
        if name not in new:
            lines += _signed("-", old[name])
        elif name not in old:
            lines += _signed("+", new[name])
        elif old[name].value != new[name].value:
            lines += _changed(old[name], new[name])
    for kind, title in _ORDERED.items():
        common = [name for name in old if name.startswith(kind) and name in new]
        if common != [name for name in new if name in {*common}]:
            lines.append(f"~ order of {title}")
    return lines


def _signed(sign: str, item: Item) -> list[str]:
    return [f"{sign} {line}" for line in item.lines()]


def _changed(old: Item, new: Item) -> list[str]:
    if "\n" not in old.value + new.value:
        return [f"~ {new.name}: {old.value or 'nothing'} -> {new.value or 'nothing'}"]
    compared = difflib.unified_diff(old.value.split("\n"), new.value.split("\n"), n=1, lineterm="")
    return [f"~ {new.name}", *(f"    {line}" for line in list(compared)[2:])]


def _inside(element: XmlElement, prefix: str) -> Iterator[Item]:
    for child in element.children():
        yield from _items(child, element.tag, prefix)


def _items(element: XmlElement, parent: str, prefix: str) -> Iterator[Item]:
    tag, name = element.tag, element.get("Name")
    if tag in _PASSED_THROUGH:
        yield from _inside(element, prefix)
    elif tag in _PORTS or tag in _CONNECTIONS:
        for child in element.children():
            yield from _port(child, _PORTS.get(tag) or _CONNECTIONS[tag], prefix)
    elif tag in ("FB", "SubApp"):
        yield Item(
            f"{'block' if tag == 'FB' else 'subapplication'} {prefix}{name}", _said(element.get("Type"), element)
        )
        yield from _inside(element, f"{prefix}{name}.")
    elif tag in ("Application", "Device", "Resource"):
        yield Item(f"{tag.lower()} {prefix}{name}", _said(element.get("Type"), element))
        yield from _inside(element, f"{prefix}{name}.")
    elif tag == "Parameter":
        yield Item(f"parameter {prefix}{name}", _said(element.get("Value"), element))
    elif tag == "Mapping":
        yield Item(f"mapping {element.get('From')} -> {element.get('To')}")
    elif tag == "ECState":
        actions = (f"{a.get('Algorithm') or '-'} / {a.get('Output') or '-'}" for a in element.children("ECAction"))
        yield Item(f"state {name}", _said(", ".join(actions), element))
    elif tag == "ECTransition":
        title = f"transition {element.get('Source')} -> {element.get('Destination')}"
        yield Item(title, _said(element.get("Condition"), element))
    elif tag in ("Algorithm", "Method"):
        texts = ((body.get("Text") or body.text) for body in element.children("ST"))
        yield Item(f"{tag.lower()} {name}", _said("\n".join(text.strip("\n") for text in texts), element))
    elif tag == "ServiceSequence":
        yield Item(f"service sequence {name}", "\n".join(_transactions(element)))
    elif tag == "VarDeclaration":
        yield from _port(element, "member" if parent == "StructuredType" else "variable", prefix)
    else:
        yield from _other(element, prefix)


def _other(element: XmlElement, prefix: str) -> Iterator[Item]:
    given = {name: value for name, value in element.attributes().items() if name not in (*_DRAWN, "Name")}
    value = ", ".join(f"{name}={value}" for name, value in given.items() if value)
    text = element.text.strip()
    yield Item(f"{element.tag} {prefix}{element.get('Name')}".rstrip(), value + (f"\n{text}" if text else ""))
    yield from _inside(element, f"{prefix}{element.get('Name') or element.tag}.")


def _port(element: XmlElement, kind: str, prefix: str) -> Iterator[Item]:
    if element.tag == "Connection":
        where = f" in {prefix[:-1]}" if prefix else ""
        yield Item(f"{kind} {element.get('Source')} -> {element.get('Destination')}{where}", _comment(element))
        return
    name, said = f"{kind} {prefix}{element.get('Name')}", element.get("Type")
    size, initial = element.get("ArraySize"), element.get("InitialValue")
    said = f"ARRAY [{size}] OF {said}" if size else "" if said == "Event" else said
    said += f" := {initial}" if initial else ""
    within = ", ".join(each.get("Var") for each in element.children("With"))
    yield Item(name, _said(f"{said} with {within}".strip() if within else said, element))


def _transactions(element: XmlElement) -> Iterator[str]:
    for transaction in element.children("ServiceTransaction"):
        for kind, sign in (("InputPrimitive", ">"), ("OutputPrimitive", "<")):
            for primitive in transaction.children(kind):
                event = f"{primitive.get('Interface')}.{primitive.get('Event')}"
                yield f"{sign} {event} {primitive.get('Parameters')}".rstrip()


def _comment(element: XmlElement) -> str:
    comment = " ".join(element.get("Comment").split())
    return f"(* {comment} *)" if comment else ""


def _said(value: str, element: XmlElement) -> str:
    """What is said of an element, with its comment: in a line of its own before a text of several lines."""
    comment = _comment(element)
    return f"{comment}\n{value}" if comment and "\n" in value else f"{value} {comment}".strip()
