"""The functions of a C unit that let time pass for it, and that queue events without delivering them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from iec61499.native.layout import Layout
from iec61499.native.services import TIMED, WAITS

SHORTEST_QUEUE: Final = 1024
LONGEST_QUEUE: Final = 32_768
"""Events that may wait at once, at least and at most."""


def timed(layout: Layout) -> list[int]:
    """The numbers of the timed blocks, in the order of the numbers that they have in the heap."""
    nodes = layout.netlist.nodes
    return [number for number, node in nodes.items() if node.type and node.type.header.name in TIMED]


def sizes(layout: Layout) -> list[str]:
    """What the header defines before it includes fb.h: how many events may wait, and how many timers there are."""
    wanted = SHORTEST_QUEUE
    while wanted < 2 * len(layout.netlist.events) and wanted < LONGEST_QUEUE:
        wanted *= 2
    given = {"FB_WAITING": wanted, "FB_TIMERS": max(1, len(timed(layout)))}
    usual = {"FB_WAITING": SHORTEST_QUEUE, "FB_TIMERS": 1}
    return [f"#define {name} {size}" for name, size in given.items() if size != usual[name]]


def checked_sizes(layout: Layout) -> list[str]:
    """What the header checks when fb.h is included, as another unit may have come before."""
    lines = []
    for line in sizes(layout):
        _, name, size = line.split()
        lines += [f"#if {name} != {size}", '#error "include this header before others that include fb.h"', "#endif"]
    return lines


def queue_size(layout: Layout) -> int:
    """How many events may wait at once."""
    defined = dict(line.split()[1:] for line in sizes(layout))
    return int(defined.get("FB_WAITING", SHORTEST_QUEUE))


def heads(name: str) -> list[str]:
    """What the header says of these functions."""
    return [
        "",
        "/* Queues what an event output leads to, or an event, each by its number. */",
        f"int32_t {name}__issue(struct {name} *unit, int32_t output);",
        f"int32_t {name}__push(struct {name} *unit, uint16_t entry);",
        "",
        "/* Moves time on to the first timed block that is due by then, ns, and queues its event; 0 without one. */",
        f"int32_t {name}__ring(struct {name} *unit, int64_t until);",
        "",
        "/* When the next timed block is due, ns; -1 when none waits. */",
        f"int64_t {name}__due(const struct {name} *unit);",
        "",
        "/* Moves time on and delivers what timed blocks issue, each at its time; returns an fb_problem. */",
        f"int32_t {name}__advance(struct {name} *unit, int64_t until);",
        "",
        "/* Drops the events that wait and ends what timed blocks wait for. */",
        f"void {name}__halt(struct {name} *unit);",
        "",
        "/* Lets a host do what its services do at events. */",
        f"void {name}__host(struct {name} *unit, int32_t (*host)(int32_t entry));",
    ]


def functions(layout: Layout, name: str) -> list[str]:
    """The definitions."""
    blocks = timed(layout)
    fire = [
        f"case {k}: {layout.tags[n]}__fire(&unit->{layout.members[n]}, run); break;" for k, n in enumerate(blocks)
    ]
    stop = [f"unit->{layout.members[number]}.{WAITS} = false;" for number in blocks]
    return _text(name, fire, stop).splitlines()


def _text(name: str, fire: Sequence[str], stop: Sequence[str]) -> str:
    fired = "\n    ".join(fire)
    stopped = "\n    ".join(stop)
    return f"""
int32_t {name}__issue(struct {name} *unit, int32_t output)
{{
    fb_issue(&unit->run, output);
    return unit->run.fault.problem;
}}

int32_t {name}__push(struct {name} *unit, uint16_t entry)
{{
    fb_push(&unit->run, entry);
    return unit->run.fault.problem;
}}

int32_t {name}__ring(struct {name} *unit, int64_t until)
{{
    struct fb_run *run = &unit->run;
    uint16_t block;
    if (run->timers == 0 || run->heap[0].due > until) {{
        run->time = until;
        return 0;
    }}
    run->time = run->heap[0].due;
    block = run->heap[0].block;
    fb_remove(run, 0);
    switch (block) {{
    {fired}
    default: break;
    }}
    return 1;
}}

int64_t {name}__due(const struct {name} *unit)
{{
    return unit->run.timers == 0 ? -1 : unit->run.heap[0].due;
}}

int32_t {name}__advance(struct {name} *unit, int64_t until)
{{
    unit->run.fault.problem = FB_FINE;
    while (fb_fine(&unit->run) && {name}__ring(unit, until)) {{
        {name}__run(unit);
    }}
    return unit->run.fault.problem;
}}

void {name}__halt(struct {name} *unit)
{{
    unit->run.waiting = 0;
    unit->run.timers = 0;
    {stopped}
}}

void {name}__host(struct {name} *unit, int32_t (*host)(int32_t entry))
{{
    unit->run.host = host;
}}
"""
