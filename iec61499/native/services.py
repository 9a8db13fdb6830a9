"""The service interface blocks that a C unit has.

They are E_RESTART, SERVER_n_m, which is served by calls, and the timers FB_TON, FB_TOF and FB_TP, as
`runtime.services.clocked` has them.
"""

from __future__ import annotations

from typing import Final

from iec61499 import model
from iec61499.errors import FunctionBlockError, choices
from iec61499.native.blocks import OUTPUTS, BlockCode, Field, block_fields
from iec61499.runtime.linking.netlist import Node
from iec61499.standard.services import COMMUNICATION
from iec61499.types import BOOL, DINT, LINT

OPEN: Final = "open__"
"""The member that tells whether a SERVER has been initialised."""
ATTACHED: Final = "attached__"
"""The member that tells whether somebody calls a SERVER, which then needs no ID."""
ANSWERS: Final = "answers__"
"""The member that counts the answers to a message."""
_START: Final = "start__"
_COUNTS: Final = "counts__"
_BEFORE: Final = "before__"
_TIMERS: Final = {
    "FB_TON": f"""
    if (self->IN) {{
        self->Q = fb_count(self, run) || self->Q;
    }} else {{
        self->Q = false;
        self->ET = 0;
        self->{_COUNTS} = false;
    }}""",
    "FB_TOF": f"""
    if (self->IN) {{
        self->Q = true;
        self->ET = 0;
        self->{_COUNTS} = false;
        self->{_BEFORE} = true;
    }} else if (self->{_BEFORE}) {{
        self->Q = !fb_count(self, run) && self->Q;
    }}""",
    "FB_TP": f"""
    if (self->{_COUNTS} && fb_count(self, run)) {{
        self->Q = false;
        self->{_COUNTS} = false;
    }}
    if (!self->{_COUNTS}) {{
        if (self->IN && !self->{_BEFORE}) {{
            self->Q = !fb_count(self, run);
            self->{_COUNTS} = self->Q;
        }} else if (!self->IN) {{
            self->ET = 0;
        }}
    }}
    self->{_BEFORE} = self->IN;""",
}
"""What the timers do at REQ; `fb_count` stands for the function that lets ET count."""


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
    if name in _TIMERS:
        timed = (Field(_START, LINT, 0), Field(_COUNTS, BOOL, False), Field(_BEFORE, BOOL, False))
        text = _timer(tag, _TIMERS[name])
        return BlockCode(
            tag, (*timed, *fields), False, tuple(text.splitlines()), {"REQ": f"{tag}__event__REQ"}, published
        )
    if match is None or match[1] != "SERVER":
        raise FunctionBlockError(
            f"C: {node.name} is a {name}: expected basic, simple and composite blocks, E_RESTART, SERVER and "
            f"{choices(_TIMERS)}",
            node.file,
            node.line,
        )
    own = (Field(OPEN, BOOL, False), Field(ATTACHED, BOOL, False), Field(ANSWERS, DINT, 0))
    outputs = {event.name: number for number, event in enumerate(block.interface.event_outputs)}
    handlers = {event: f"{tag}__event__{event}" for event in ("INIT", "RSP")}
    lines = _server(tag, outputs["INITO"], outputs["IND"])
    return BlockCode(tag, (*own, *fields), False, tuple(lines.splitlines()), handlers, published)


def _timer(tag: str, reaction: str) -> str:
    return f"""
/* Lets ET count, from now on when it did not; whether it has reached PT. */
static bool {tag}__count(struct {tag} *self, const struct fb_run *run)
{{
    int64_t elapsed, most = self->PT > 0 ? self->PT : 0;
    if (!self->{_COUNTS}) {{
        self->{_COUNTS} = true;
        self->{_START} = run->time;
    }}
    elapsed = run->time - self->{_START};
    self->ET = elapsed < most ? elapsed : most;
    return elapsed >= self->PT;
}}

static void {tag}__event__REQ(struct {tag} *self, struct fb_run *run)
{{{reaction.replace("fb_count", f"{tag}__count")}
    fb_issue(run, self->{OUTPUTS});
}}
"""


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
