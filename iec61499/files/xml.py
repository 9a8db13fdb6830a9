"""Reads XML that may come from anywhere: no entities, no network, no DTD, bounded size and depth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from lxml import etree

from iec61499.errors import FunctionBlockError, choices
from iec61499.files.dialects import dialect_of_namespace, dialect_of_text

MAXIMUM_SIZE: Final = 4 * 2**20
"""Most bytes of a file."""
MAXIMUM_DEPTH: Final = 64
"""Most levels of elements inside one another."""
_PARSER: Final = etree.XMLParser(
    resolve_entities=False,
    no_network=True,
    load_dtd=False,
    dtd_validation=False,
    huge_tree=False,
    remove_comments=True,
    remove_pis=True,
)
"""Takes longer to make than to parse a request with; it keeps nothing of what it has parsed."""


class XmlElement:
    """An element with its file and line, and readers that turn what is missing or wrong into one-line errors."""

    __slots__ = ("_element", "file")

    def __init__(self, element: Any, file: str) -> None:
        self._element = element
        self.file = file

    @property
    def tag(self) -> str:
        return str(self._element.tag)

    @property
    def namespaces(self) -> str:
        """The XML namespaces that the element declares or is in."""
        return " ".join(map(str, self._element.nsmap.values()))

    @property
    def line(self) -> int:
        return int(self._element.sourceline)

    @property
    def text(self) -> str:
        """The character data directly inside."""
        return self._element.text or ""

    def children(self, tag: str = "") -> Iterator[XmlElement]:
        """The child elements, of one tag if it is given, in order."""
        for child in self._element.iterchildren(tag or "*"):
            yield XmlElement(child, self.file)

    @property
    def parent(self) -> XmlElement:
        """The element that this one is in; itself at the root."""
        above = self._element.getparent()
        return self if above is None else XmlElement(above, self.file)

    def child(self, tag: str) -> XmlElement | None:
        """The first child of that tag."""
        return next(self.children(tag), None)

    def descendants(self, tag: str) -> Iterator[XmlElement]:
        """The elements of one tag at any depth, in order."""
        for element in self._element.iter(tag):
            yield XmlElement(element, self.file)

    def put(self, name: str, value: str) -> None:
        """Gives an attribute another value."""
        self._element.set(name, value)

    def expect_children(self, tags: Sequence[str]) -> None:
        """Raises FunctionBlockError at the first child with a tag that is not among `tags`."""
        for child in self.children():
            if child.tag not in tags:
                valid = f"expected {choices([f'<{tag}>' for tag in tags])}"
                raise child.error(f"unknown element <{child.tag}> in <{self.tag}>: {valid}")

    def get(self, name: str, default: str = "") -> str:
        """An attribute, or the default."""
        return str(self._element.get(name, default))

    def require(self, name: str) -> str:
        """An attribute that must be there and not be empty."""
        value = self.get(name)
        if not value:
            present = sorted(map(str, self._element.attrib))
            has = f"it has {choices(present)}" if present else "it has none"
            raise self.error(f"<{self.tag}> needs the attribute {name}, {has}")
        return value

    def attributes(self) -> dict[str, str]:
        """All attributes, in their order."""
        return {str(name): str(value) for name, value in self._element.attrib.items()}

    def number(self, name: str) -> float:
        """An attribute as a number, 0 when it is missing or no number (no coordinate keeps a block from running)."""
        try:
            return float(self.get(name, "0"))
        except ValueError:
            return 0.0

    def error(self, message: str) -> FunctionBlockError:
        """An error at this element."""
        return FunctionBlockError(message, self.file, self.line)


def read_xml(path: Path, *, foreign: bool = False) -> XmlElement:
    """The root element of a file.

    Args:
        path: the file.
        foreign: whether files of other tools are taken, too.

    Raises:
        FunctionBlockError: the file cannot be read, is another tool's, is not well-formed, defines or uses entities,
            is larger than MAXIMUM_SIZE or deeper than MAXIMUM_DEPTH.
    """
    try:
        with path.open("rb") as stream:
            data = stream.read(MAXIMUM_SIZE + 1)
    except OSError as error:
        raise FunctionBlockError(f"cannot be read: {error.strerror}", str(path)) from None
    other = "" if foreign or data.lstrip()[:1] == b"<" else dialect_of_text(data)
    if other:
        raise FunctionBlockError(other, str(path))
    root = parse_xml(data, str(path))
    other = dialect_of_namespace(root.namespaces)
    if other and not foreign:
        raise root.error(other)
    return root


def parse_xml(data: bytes, file: str) -> XmlElement:
    """The root element of a text; `file` names it in errors. Raises as `read_xml` does."""
    if len(data) > MAXIMUM_SIZE:
        raise FunctionBlockError(f"is larger than {MAXIMUM_SIZE} bytes", file)
    try:
        root = etree.fromstring(data, _PARSER)
    except etree.XMLSyntaxError as error:
        line, column = error.position
        raise FunctionBlockError(f"not well-formed XML: {error.msg}", file, line, column) from None
    except ValueError as error:
        raise FunctionBlockError(f"not well-formed XML: {error}", file) from None
    if not _is_flat(data):
        dtd = root.getroottree().docinfo.internalDTD
        if dtd is not None and next(dtd.iterentities(), None) is not None:
            raise FunctionBlockError("entity definitions are not accepted", file, 1)
        _check_tree(root, file)
    return XmlElement(root, file)


def _is_flat(data: bytes) -> bool:
    """Whether a text can have neither a DTD nor too many levels, as its bytes show: most messages are so."""
    utf8 = data[:1] == b"<" and data[1:2] != b"?"  # No declaration names another encoding.
    return utf8 and b"!" not in data and data.count(b"<") <= MAXIMUM_DEPTH


def _check_tree(root: Any, file: str) -> None:
    level, elements = 1, [root]
    while elements:
        if level > MAXIMUM_DEPTH:
            raise FunctionBlockError(
                f"elements are nested deeper than {MAXIMUM_DEPTH} levels", file, elements[0].sourceline
            )
        for element in elements:
            if element.tag is etree.Entity:
                raise FunctionBlockError("entity references are not accepted", file, element.sourceline)
        elements = [child for element in elements for child in element]
        level += 1
