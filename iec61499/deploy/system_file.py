"""Writes system configurations (.sys) as 4diac IDE does (IEC 61499-2 XML), one application each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final
from xml.sax.saxutils import quoteattr

from iec61499.model import Block, Connection, DeviceDeclaration, Parameter, System

_APART: Final = 1000.0
"""Between drawn devices, in the units of 4diac IDE."""


def system_text(whole: System) -> str:
    """The text of a system of one application, whose devices are drawn side by side on one network."""
    (application,), header = whole.applications, whole.header
    name, comment = quoteattr(header.name), quoteattr(header.comment)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f"<System Name={name} Comment={comment}>",
        f'\t<Identification Standard={quoteattr(header.standard)} Classification="" ApplicationDomain=""'
        f' Function={comment} Type="" Description={quoteattr(header.description)}>',
        "\t</Identification>",
    ]
    for each in header.versions:
        lines.append(
            f"\t<VersionInfo Organization={quoteattr(each.organization)} Version={quoteattr(each.version)}"
            f" Author={quoteattr(each.author)} Date={quoteattr(each.date)} Remarks={quoteattr(each.remarks)}>"
        )
        lines.append("\t</VersionInfo>")
    lines.append(f"\t<Application Name={quoteattr(application.name)} Comment={quoteattr(application.comment)}>")
    lines.append("\t\t<SubAppNetwork>")
    lines += [line for block in application.network.blocks for line in _block(block)]
    lines += _connections("EventConnections", application.network.events, "\t\t\t")
    lines += _connections("DataConnections", application.network.data, "\t\t\t")
    lines += ["\t\t</SubAppNetwork>", "\t</Application>"]
    for number, device in enumerate(whole.devices):
        lines += _device(device, number)
    lines += [
        f"\t<Mapping From={quoteattr(each.source)} To={quoteattr(each.destination)}/>" for each in whole.mappings
    ]
    lines += ['\t<Segment Name="Ethernet" Type="Ethernet" Comment="" x="0.0" y="100.0" dx1="1500.0">', "\t</Segment>"]
    lines += [
        f'\t<Link SegmentName="Ethernet" CommResource={quoteattr(device.name)} Comment=""/>'
        for device in whole.devices
    ]
    return "\n".join([*lines, "</System>", ""])


def _block(block: Block) -> list[str]:
    ends = f"Name={quoteattr(block.name)} Type={quoteattr(block.type_name)} Comment={quoteattr(block.comment)}"
    return [
        f'\t\t\t<FB {ends} x="{block.x}" y="{block.y}">',
        *(f"\t\t\t\t{_parameter(parameter)}" for parameter in block.parameters),
        "\t\t\t</FB>",
    ]


def _device(device: DeviceDeclaration, number: int) -> list[str]:
    ends = f"Name={quoteattr(device.name)} Type={quoteattr(device.type_name)} Comment={quoteattr(device.comment)}"
    lines = [f'\t<Device {ends} x="{_APART * (number + 1)}" y="500.0">']
    lines += [f"\t\t{_parameter(parameter)}" for parameter in device.parameters]
    lines.append('\t\t<Attribute Name="Profile" Type="STRING" Value="HOLOBLOC" Comment="device profile"/>')
    for resource in device.resources:
        ends = f"Name={quoteattr(resource.name)} Type={quoteattr(resource.type_name)}"
        lines.append(f'\t\t<Resource {ends} Comment={quoteattr(resource.comment)} x="0.0" y="0.0">')
        lines.append("\t\t\t<FBNetwork>")
        lines += _connections("EventConnections", resource.network.events, "\t\t\t\t")
        lines += ["\t\t\t</FBNetwork>", "\t\t</Resource>"]
    return [*lines, "\t</Device>"]


def _parameter(parameter: Parameter) -> str:
    return f"<Parameter Name={quoteattr(parameter.name)} Value={quoteattr(parameter.value, {chr(34): '&quot;'})}/>"


def _connections(tag: str, connections: Sequence[Connection], indent: str) -> list[str]:
    return [
        f"{indent}<{tag}>",
        *(
            f"{indent}\t<Connection Source={quoteattr(each.source)} Destination={quoteattr(each.destination)}"
            ' Comment=""/>'
            for each in connections
        ),
        f"{indent}</{tag}>",
    ]
