"""An application as a system file of 4diac IDE."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final
from xml.sax.saxutils import quoteattr

from iec61499 import model

_DEVICE: Final = "FORTE_PC"
_RESOURCE: Final = "EMB_RES"


def system_text(name: str, application: str, network: model.FBNetwork, values: Mapping[str, Any], first: str) -> str:
    """The text of a system with one device, on whose resource the whole application runs.

    Args:
        name: name of the system.
        application: name of the application.
        network: blocks and connections.
        values: values of inputs, by `BLOCK.INPUT`.
        first: the block that is initialised when the device starts.
    """
    comment = f"Control of the arm {name}"
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f"<System Name={quoteattr(name)} Comment={quoteattr(comment)}>",
        '\t<Identification Standard="61499-2" Classification="Serial arm" ApplicationDomain="Robot control" '
        f'Function={quoteattr(comment)} Type="" Description="Made by dtwin fb make.">',
        "\t</Identification>",
        '\t<VersionInfo Organization="dtwin" Version="1.0" Author="dtwin" Date="2026-11-27" Remarks="Made by dtwin">',
        "\t</VersionInfo>",
        f"\t<Application Name={quoteattr(application)} Comment={quoteattr(comment)}>",
        "\t\t<SubAppNetwork>",
        *(line for block in network.blocks for line in _block(block, values)),
        *_connections("EventConnections", network.events, "\t\t\t"),
        *_connections("DataConnections", network.data, "\t\t\t"),
        "\t\t</SubAppNetwork>",
        "\t</Application>",
        f'\t<Device Name="{_DEVICE}" Type="FORTE_PC" Comment="Runtime of the controller" x="700.0" y="100.0">',
        '\t\t<Parameter Name="MGR_ID" Value="&quot;localhost:61499&quot;"/>',
        '\t\t<Attribute Name="Profile" Type="STRING" Value="HOLOBLOC" Comment="device profile"/>',
        f'\t\t<Resource Name="{_RESOURCE}" Type="EMB_RES" Comment="Resource of the application" x="0.0" y="0.0">',
        "\t\t\t<FBNetwork>",
        *_connections(
            "EventConnections",
            [model.Connection(f"START.{start}", f"{first}.INIT") for start in ("COLD", "WARM")],
            "\t\t\t\t",
        ),
        "\t\t\t</FBNetwork>",
        "\t\t</Resource>",
        "\t</Device>",
        *(
            f'\t<Mapping From="{application}.{block.name}" To="{_DEVICE}.{_RESOURCE}.{block.name}"/>'
            for block in network.blocks
        ),
        '\t<Segment Name="Ethernet" Type="Ethernet" Comment="Network of the arm" x="2400.0" y="100.0" dx1="1500.0">',
        "\t</Segment>",
        f'\t<Link SegmentName="Ethernet" CommResource="{_DEVICE}" Comment=""/>',
        "</System>",
    ]
    return "\n".join(lines) + "\n"


def literal(value: Any) -> str:
    """A truth value, number or row of numbers as a literal of IEC 61131-3."""
    if isinstance(value, bool):
        return str(value).upper()
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(literal, value))}]"
    return repr(value)


def _block(block: model.Block, values: Mapping[str, Any]) -> list[str]:
    given = {parameter.name: parameter.value for parameter in block.parameters}
    own = {key.partition(".")[2]: value for key, value in values.items() if key.partition(".")[0] == block.name}
    given |= {name: literal(value) for name, value in own.items()}
    head = f"<FB Name={quoteattr(block.name)} Type={quoteattr(block.type_name)} Comment={quoteattr(block.comment)}"
    return [
        f'\t\t\t{head} x="{block.x}" y="{block.y}">',
        *(
            f"\t\t\t\t<Parameter Name={quoteattr(name)} Value={quoteattr(text, {chr(34): '&quot;'})}/>"
            for name, text in given.items()
        ),
        "\t\t\t</FB>",
    ]


def _connections(tag: str, connections: Sequence[model.Connection], indent: str) -> list[str]:
    return [
        f"{indent}<{tag}>",
        *(
            f'{indent}\t<Connection Source="{c.source}" Destination="{c.destination}" Comment=""/>'
            for c in connections
        ),
        f"{indent}</{tag}>",
    ]
