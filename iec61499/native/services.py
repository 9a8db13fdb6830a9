"""The service interface blocks that a C unit has.

They are E_RESTART, SERVER_n_m, which is served by calls, the timed events of `runtime.timers`, and the timers and
stop watch of `runtime.services.clocked`. In a unit with a host all other services, and SERVER, are the host's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from iec61499 import model
from iec61499.errors import FunctionBlockError, choices
from iec61499.native.blocks import OUTPUTS, BlockCode, Field, block_fields
from iec61499.runtime.linking.netlist import Node
from iec61499.st.c.names import c_name
from iec61499.standard.services import COMMUNICATION
from iec61499.types import BOOL, DINT, LINT, UINT

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
_WATCH: Final = {
    "START": f"""
    if (!self->{_COUNTS}) {{{{
        self->{_COUNTS} = true;
        self->{_START} = run->time;
    }}}}""",
    "ET": f"""
    if (self->{_COUNTS}) {{{{
        self->TD = run->time - self->{_START};
        fb_issue(run, self->{OUTPUTS} + {{ETO}});
    }}}}""",
    "STOP": f"""
    if (self->{_COUNTS}) {{{{
        self->TD = run->time - self->{_START};
        self->{_COUNTS} = false;
        fb_issue(run, self->{OUTPUTS} + {{EO}});
    }}}}""",
    "RESET": f"""
    self->TD = 0;
    self->{_COUNTS} = false;
    fb_issue(run, self->{OUTPUTS} + {{RESETO}});""",
}
"""What E_STOPWATCH does at each event, with the numbers of its event outputs to be put in."""
TIMER: Final = "timer__"
"""The member that holds the number of a timed block."""
WAITS: Final = "waits__"
"""The member that tells whether a timed block waits for its time."""
_PERIOD: Final = "period__"
_RESTART: Final = f"""
    if (self->{WAITS}) {{
        fb_cancel(run, self->{TIMER});
    }}
    self->{WAITS} = true;
    fb_schedule(run, self->{TIMER}, self->DT);"""
_ONCE: Final = f"""
    if (!self->{WAITS}) {{
        self->{WAITS} = true;
        fb_schedule(run, self->{TIMER}, self->DT);
    }}"""
_REPEATED: Final = f"""
    if (!self->{WAITS}) {{
        self->{WAITS} = true;
        self->{_PERIOD} = self->DT;
        fb_schedule(run, self->{TIMER}, self->{_PERIOD});
    }}"""
TIMED: Final = {
    "E_DELAY": (_ONCE, f"self->{WAITS} = false;"),
    "E_RDELAY": (_RESTART, f"self->{WAITS} = false;"),
    "E_CYCLE": (_REPEATED, f"fb_schedule(run, self->{TIMER}, self->{_PERIOD});"),
}
"""What the timed blocks do at START, and before they issue EO."""


def is_hosted(block: model.FBType) -> bool:
    """Whether a unit with a host leaves the block to it."""
    own = ("E_RESTART", "E_STOPWATCH", *TIMED, *_TIMERS)
    return isinstance(block, model.ServiceInterfaceFBType) and block.header.name not in own


def service_code(block: model.ServiceInterfaceFBType, tag: str, node: Node, hosted: bool) -> BlockCode:
    """The C code of a service interface block.

    Args:
        block: its type, without generic variables.
        tag: the name of its structure.
        node: the first block of the type.
        hosted: whether the unit has a host.

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
    if name in TIMED:
        waiting = (Field(TIMER, UINT, 0), Field(WAITS, BOOL, False), Field(_PERIOD, LINT, 0))
        handlers = {event: f"{tag}__event__{event}" for event in ("START", "STOP")}
        return BlockCode(tag, (*waiting, *fields), False, tuple(_timed(tag, *TIMED[name]).splitlines()), handlers, {})
    if name == "E_STOPWATCH":
        counting = (Field(_START, LINT, 0), Field(_COUNTS, BOOL, False))
        handlers = {event: f"{tag}__event__{event}" for event in ("START", "ET", "STOP", "RESET")}
        numbers = {event.name: number for number, event in enumerate(block.interface.event_outputs)}
        watch = tuple(_stop_watch(tag, numbers).splitlines())
        return BlockCode(tag, (*counting, *fields), False, watch, handlers, published)
    if hosted:
        handlers = {event.name: f"{tag}__event__{c_name(event.name)}" for event in block.interface.event_inputs}
        asking = tuple(line for handler in handlers.values() for line in _asking(tag, handler).splitlines())
        members = {variable.name: c_name(variable.name) for variable in block.interface.outputs}
        return BlockCode(tag, fields, False, asking, handlers, members)
    if match is None or match[1] != "SERVER":
        raise FunctionBlockError(
            f"C: {node.name} is a {name}: expected basic, simple and composite blocks, E_RESTART, SERVER, "
            f"E_STOPWATCH, {choices([*TIMED, *_TIMERS])}",
            node.file,
            node.line,
        )
    own = (Field(OPEN, BOOL, False), Field(ATTACHED, BOOL, False), Field(ANSWERS, DINT, 0))
    outputs = {event.name: number for number, event in enumerate(block.interface.event_outputs)}
    handlers = {event: f"{tag}__event__{event}" for event in ("INIT", "RSP")}
    lines = _server(tag, outputs["INITO"], outputs["IND"])
    return BlockCode(tag, (*own, *fields), False, tuple(lines.splitlines()), handlers, published)


def _asking(tag: str, handler: str) -> str:
    return f"""
static void {handler}(struct {tag} *self, struct fb_run *run)
{{
    (void)self;
    fb_ask(run);
}}
"""


def _timed(tag: str, starting: str, elapsed: str) -> str:
    return f"""
static void {tag}__event__START(struct {tag} *self, struct fb_run *run)
{{{starting}
}}

static void {tag}__event__STOP(struct {tag} *self, struct fb_run *run)
{{
    if (self->{WAITS}) {{
        fb_cancel(run, self->{TIMER});
        self->{WAITS} = false;
    }}
}}

/* The time has come that it waited for. */
static void {tag}__fire(struct {tag} *self, struct fb_run *run)
{{
    {elapsed}
    fb_issue(run, self->{OUTPUTS});
}}
"""


def _stop_watch(tag: str, outputs: Mapping[str, int]) -> str:
    heads = {event: f"static void {tag}__event__{event}(struct {tag} *self, struct fb_run *run)" for event in _WATCH}
    return "".join(f"\n{heads[event]}\n{{{text.format(**outputs)}\n}}\n" for event, text in _WATCH.items())


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
