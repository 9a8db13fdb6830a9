"""The resources of a system as files of C."""

from __future__ import annotations

from pathlib import Path

from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.native.build import unit_files
from iec61499.native.layout import network_layout
from iec61499.native.unit import unit_of
from iec61499.st.c.names import c_name


def c_files(library: Library, system: Path) -> dict[str, str]:
    """The texts of the C files of every resource of a system, by name.

    A unit has the name of the system, or of device and resource where there are several.

    Raises:
        FunctionBlockError: the system is wrong, or needs what C cannot do; names file and line, and in Structured
            Text the column.
    """
    drawn = library.load_system(system)
    resources = [f"{device.name}.{resource.name}" for device in drawn.devices for resource in device.resources]
    texts: dict[str, str] = {}
    for resource in resources:
        name = c_name(resource.replace(".", "_") if len(resources) > 1 else drawn.header.name)
        layout = network_layout(resource_network(drawn, resource), library)
        texts |= unit_files(unit_of(layout, name), name)
    return texts
