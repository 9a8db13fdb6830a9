"""Reads the links of a 4diac project (`.project` of Eclipse) to folders of types outside of it."""

from __future__ import annotations

import os
import re
from pathlib import Path, PurePosixPath
from typing import Final
from urllib.parse import unquote

from iec61499.files.xml import XmlElement, read_xml

PROJECT: Final = ".project"
_FOLDER: Final = "2"
_PARENT: Final = re.compile(r"PARENT-(\d)-PROJECT_LOC")


def linked_folders(project: Path) -> tuple[Path, ...]:
    """The folders that a project links to and that are there, in the order of its file; none without a `.project`.

    Links begin with a variable of Eclipse: WORKSPACE_LOC is taken for the folder around the project, and ECLIPSE_HOME
    is the environment's variable of that name, the folder of 4diac IDE. Others are left out, as are links that lead
    upwards.

    Raises:
        FunctionBlockError: the file is unreadable or not well-formed.
    """
    file = project / PROJECT
    if not file.is_file():
        return ()
    group = read_xml(file).child("linkedResources")
    links = group.children("link") if group is not None else ()
    found = (_target(link, project.resolve()) for link in links if _text(link, "type") == _FOLDER)
    return tuple(folder for folder in found if folder is not None and folder.is_dir())


def _target(link: XmlElement, project: Path) -> Path | None:
    parts = PurePosixPath(unquote(_text(link, "locationURI"))).parts
    if not parts or ".." in parts:
        return None
    base = _base(parts[0], project)
    return base.joinpath(*parts[1:]) if base is not None else None


def _base(variable: str, project: Path) -> Path | None:
    if variable == "WORKSPACE_LOC":
        return project.parent
    if variable == "PROJECT_LOC":
        return project
    if variable == "ECLIPSE_HOME":
        home = os.environ.get(variable)
        return Path(home) if home else None
    parent = _PARENT.fullmatch(variable)
    if parent is None or not 1 <= int(parent[1]) <= len(project.parents):
        return None
    return project.parents[int(parent[1]) - 1]


def _text(element: XmlElement, tag: str) -> str:
    child = element.child(tag)
    return child.text.strip() if child is not None else ""
