"""Reads what a project of 4diac IDE says beside its systems and types.

`.project` of Eclipse links to folders of types outside of it. `virtualDNS.dns` gives values to names such as
`%SERVER%` in parameters, which 4diac IDE puts in their place when it deploys; one of its collections is active.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import Final
from urllib.parse import unquote

from iec61499.files.xml import XmlElement, read_xml

PROJECT: Final = ".project"
MANIFEST: Final = "MANIFEST.MF"
"""File that names the libraries which a project or a library needs."""
FOREIGN: Final = "*.dfbproj"
"""File of a project of EcoStruxure Automation Expert, in the folder of its types."""
_FOLDER: Final = "2"
_SYMBOL: Final = re.compile(r"[\w.-]+", re.ASCII)
TAGS: Final = "virtualDNS.dns"
_TAG: Final = re.compile(r"%([^%]+)%")
_ACTIVE: Final = re.compile(r"//@availableDNSCollections\.([0-9]{1,4})")
_PARENT: Final = re.compile(r"PARENT-(\d)-PROJECT_LOC")


def project_of(file: Path, given: Iterable[Path] = ()) -> Path:
    """The folder whose types a file may use.

    It is the nearest one above with a project or a library of 4diac IDE, or with a project of EcoStruxure Automation
    Expert; else the one of `given` that holds the file; else its own.
    """
    folders = file.resolve().parents
    marked = next((each for each in folders if _is_marked(each)), None)
    if marked is not None:
        return marked
    around = {each.resolve(): each for each in given}
    return next((around[each] for each in reversed(folders) if each in around), file.parent)


def _is_marked(folder: Path) -> bool:
    """Whether a folder is the root of a project or a library."""
    return any((folder / name).is_file() for name in (PROJECT, MANIFEST)) or any(folder.glob(FOREIGN))


def linked_folders(project: Path) -> tuple[Path, ...]:
    """The folders that a project links to or needs and that are there, in the order of its files; none without any.

    A library in a workspace's folder `.lib` names others that it needs in `MANIFEST.MF`, which are beside it; one
    that names none may need all of them. Links of
    a `.project` begin with a variable of Eclipse: WORKSPACE_LOC is taken for the folder around the project, and
    ECLIPSE_HOME is the environment's variable of that name, the folder of 4diac IDE. Others are left out, as are
    links that lead upwards.

    Raises:
        FunctionBlockError: the file is unreadable or not well-formed.
    """
    needed = _needed_folders(project)
    file = project / PROJECT
    if not file.is_file():
        return needed
    group = read_xml(file).child("linkedResources")
    links = group.children("link") if group is not None else ()
    found = (_target(link, project.resolve()) for link in links if _text(link, "type") == _FOLDER)
    return (*(folder for folder in found if folder is not None and folder.is_dir()), *needed)


def _needed_folders(library: Path) -> tuple[Path, ...]:
    """The libraries beside one in `.lib` that it needs, and those that they need; all when it does not say."""
    if library.resolve().parent.name != ".lib":
        return ()
    manifest = library.resolve() / MANIFEST
    if not manifest.is_file() or read_xml(manifest).child("Dependencies") is None:
        # what is loaded into one project finds all of its types there
        return tuple(sorted(each for each in library.resolve().parent.iterdir() if (each / MANIFEST).is_file()))
    found: dict[Path, None] = {}
    waiting = [library.resolve()]
    while waiting:
        file = waiting.pop() / MANIFEST
        group = read_xml(file).child("Dependencies") if file.is_file() else None
        for needed in group.children("Required") if group is not None else ():
            name = needed.get("SymbolicName")
            beside = sorted(file.parent.parent.glob(f"{name}-*")) if _SYMBOL.fullmatch(name) else []
            for folder in beside[-1:]:
                if folder.is_dir() and folder not in found:
                    found[folder] = None
                    waiting.append(folder)
    return tuple(found)


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


def read_tags(folder: Path) -> dict[str, str]:
    """The values of a system's project by their names; none where there is no such file.

    Args:
        folder: the folder of the system; the file is there, or in one above it within the project.

    Raises:
        FunctionBlockError: the file is unreadable or not well-formed.
    """
    for each in (folder, *folder.parents):
        if (each / TAGS).is_file():
            return _active(read_xml(each / TAGS, foreign=True))
        if (each / PROJECT).is_file():
            break
    return {}


def put_tags(root: XmlElement, tags: dict[str, str]) -> None:
    """Puts the values of names into the parameters below an element; names without a value stay as they are."""
    if not tags:
        return
    for parameter in root.descendants("Parameter"):
        value = parameter.get("Value")
        if "%" in value:
            parameter.put("Value", _TAG.sub(lambda found: tags.get(found[1], found[0]), value))


def _active(root: XmlElement) -> dict[str, str]:
    collections = list(root.children("availableDNSCollections"))
    found = _ACTIVE.fullmatch(root.get("activeVirtualDNS"))
    number = int(found[1]) if found is not None else 0
    if number >= len(collections):
        return {}
    entries = collections[number].children("virtualDNSEntries")
    return {entry.get("name"): entry.get("value") for entry in entries if entry.get("name")}
