"""Names such as `%SERVER%` in parameters of a system, which the file `virtualDNS.dns` of its project gives values.

4diac IDE puts the values in their place when it deploys. A file has several collections, one of which is active.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from iec61499.files.project import PROJECT
from iec61499.files.xml import XmlElement, read_xml

FILE: Final = "virtualDNS.dns"
_TAG: Final = re.compile(r"%([^%]+)%")
_ACTIVE: Final = re.compile(r"//@availableDNSCollections\.([0-9]{1,4})")


def read_tags(folder: Path) -> dict[str, str]:
    """The values of a system's project by their names; none where there is no such file.

    Args:
        folder: the folder of the system; the file is there, or in one above it within the project.

    Raises:
        FunctionBlockError: the file is unreadable or not well-formed.
    """
    for each in (folder, *folder.parents):
        if (each / FILE).is_file():
            return _active(read_xml(each / FILE, foreign=True))
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
