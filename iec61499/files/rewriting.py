"""Changes the Structured Text inside a file and leaves every other byte as it is."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Final
from xml.sax.saxutils import escape, unescape

from iec61499.errors import FunctionBlockError
from iec61499.files.xml import parse_xml

_ENTITIES: Final = {"&quot;": '"', "&apos;": "'"}
_NUMBERED: Final = re.compile(r"&#(?:x([0-9A-Fa-f]+)|([0-9]+));")
_COMMENT: Final = re.compile(r"<!--.*?-->", re.DOTALL)
_TEXT: Final = re.compile(r"<ST\b((?:\s[^<>]*)?)(?:/>|>(.*?)</ST\s*>)", re.DOTALL)
_ATTRIBUTE: Final = re.compile(r"(\sText\s*=\s*)(?:\"([^\"]*)\"|'([^']*)')")
_CDATA: Final = re.compile(r"(\s*<!\[CDATA\[)(.*?)(\]\]>\s*)", re.DOTALL)
_DECLARED: Final = re.compile(rb"^\s*<\?xml[^>]*encoding\s*=\s*[\"']([\w.-]+)[\"']")


def rewrite(data: bytes, change: Callable[[str, int], str], file: str = "") -> bytes:
    """The file with every text in Structured Text changed.

    Args:
        data: the file, as XML.
        change: gives another text for a text and the line of the file that it begins in.
        file: name of the file, for errors.

    Raises:
        FunctionBlockError: the file is no XML, or its encoding is not known.
    """
    parse_xml(data, file)
    declared = _DECLARED.match(data)
    encoding = declared[1].decode() if declared is not None else "utf-8"
    try:
        whole = data.decode(encoding)
    except (LookupError, UnicodeDecodeError):
        raise FunctionBlockError(f"is not in the encoding {encoding} that it declares", file, 1) from None
    ends = "\r\n" if "\r\n" in whole else "\n"
    comments = [found.span() for found in _COMMENT.finditer(whole)]

    def changed(found: re.Match[str]) -> str:
        if any(start <= found.start() < end for start, end in comments):
            return found[0]
        line = whole.count("\n", 0, found.start()) + 1
        attribute = _ATTRIBUTE.search(found[1])
        if attribute is not None:
            return found[0].replace(attribute[0], _changed_attribute(attribute, change, line), 1)
        if found[2] is None:
            return found[0]
        start = found.start(2) - found.start()
        content = _changed_content(found[2], change, line, ends)
        return f"{found[0][:start]}{content}{found[0][start + len(found[2]) :]}"

    return _TEXT.sub(changed, whole).encode(encoding)


def _changed_content(content: str, change: Callable[[str, int], str], line: int, ends: str) -> str:
    section = _CDATA.fullmatch(content)
    if section is not None:
        text = change(section[2].replace("\r\n", "\n"), line)
        return f"{section[1]}{text.replace(chr(10), ends)}{section[3]}"
    if "<" in content:
        return content  # several sections, or elements: nothing that an editor writes
    before = _plain(content).replace("\r\n", "\n")
    text = change(before, line)
    return content if text == before else escape(text).replace("\n", ends)


def _changed_attribute(attribute: re.Match[str], change: Callable[[str, int], str], line: int) -> str:
    before = _plain(attribute[2] if attribute[2] is not None else attribute[3])
    text = change(before, line)
    if text == before:
        return attribute[0]
    written = escape(text, {'"': "&quot;", "\n": "&#10;", "\t": "&#9;"})
    return f'{attribute[1]}"{written}"'


def _plain(text: str) -> str:
    """Text without entities."""
    numbered = _NUMBERED.sub(lambda found: chr(int(found[1], 16) if found[1] else int(found[2])), text)
    return unescape(numbered, _ENTITIES)
