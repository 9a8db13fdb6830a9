"""The service interface blocks that a C unit has: E_RESTART and SERVER_n_m, which is served by calls."""

from __future__ import annotations

from typing import Final

from dtwin.errors import FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.native.blocks import OUTPUTS, BlockCode, Field, block_fields
from dtwin.iec61499.runtime.linking.netlist import Node
from dtwin.iec61499.standard.services import COMMUNICATION
from dtwin.iec61499.types import BOOL, DINT

OPEN: Final = "open__"
"""The member that tells whether a SERVER has been initialised."""
ATTACHED: Final = "attached__"
"""The member that tells whether somebody calls a SERVER, which then needs no ID."""
ANSWERS: Final = "answers__"
"""The member that counts the answers to a message."""


def service_code(block: model.ServiceInterfaceFBType, tag: str, node: Node) -> BlockCode:
    """The C code of a service interface block.

    Raises:
        FunctionBlockError: there is none for this type; names the file and line of the block.
    """
    name = block.header.name
    match = COMMUNICATION.fullmatch(name)
    fields = block_fields(block)
    published = {variable.name: variable.name for variable in block.interface.outputs}
    if name == "E_RESTART":
        return BlockCode(tag, fields, False, (), {}, published)
    if match is None or match[1] != "SERVER":
        raise FunctionBlockError(
            f"C: {node.name} is a {name}: expected basic, simple and composite blocks, E_RESTART and SERVER",
            node.file,
            node.line,
        )
    own = (Field(OPEN, BOOL, False), Field(ATTACHED, BOOL, False), Field(ANSWERS, DINT, 0))
    outputs = {event.name: number for number, event in enumerate(block.interface.event_outputs)}
    handlers = {event: f"{tag}__event__{event}" for event in ("INIT", "RSP")}
    lines = _server(tag, outputs["INITO"], outputs["IND"])
    return BlockCode(tag, (*own, *fields), False, tuple(lines.splitlines()), handlers, published)


def _server(tag: str, initialised: int, indication: int) -> str:
    return f"""
static void {tag}__report(struct {tag} *self, struct fb_run *run, struct fb_text status, bool good, int32_t output)
{{
    fb_assign(&self->STATUS, status);
    self->QO = good;
    fb_issue(run, self->{OUTPUTS} + output);
}}

static void {tag}__event__INIT(struct {tag} *self, struct fb_run *run)
{{
    if (!self->QI) {{
        self->{OPEN} = false;
        {tag}__report(self, run, fb_literal("TERMINATED", 10), false, {initialised});
    }} else if (!self->{OPEN} && !self->{ATTACHED} && self->ID.length == 0) {{
        {tag}__report(self, run, fb_literal("INVALID_ID", 10), false, {initialised});
    }} else {{
        self->{OPEN} = true;
        {tag}__report(self, run, fb_literal("OK", 2), true, {initialised});
    }}
}}

static void {tag}__event__RSP(struct {tag} *self, struct fb_run *run)
{{
    if (self->QI && self->{OPEN}) {{
        ++self->{ANSWERS};
    }} else {{
        const struct fb_text status = self->QI ? fb_literal("NO_SOCKET", 9) : fb_literal("INHIBITED", 9);
        {tag}__report(self, run, status, false, {indication});
    }}
}}
"""
