"""Links between resources in which every event is acknowledged before the next one goes out.

4diac FORTE has one buffer for what a communication block has received. Datagrams that come to a SUBSCRIBE while an
earlier one waits there are decoded together, one over the other, and cause one event (`handledConnectedDataRecv` and
`processInterrupt` of ipcomlayer.cpp, `recvData` of fbdkasn1layer.cpp). So a sender has to wait: here a queue of
events hands its oldest one to a CLIENT and the next when this one has its answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.standard.notation import interface, variables
from iec61499.types import DataType, ElementaryType

WAITING: Final = 16
"""Most events that wait in a queue; what comes then is lost."""
RETRY: Final = "T#100ms"
"""Time between two attempts to connect. An E_CYCLE makes them, as an E_DELAY that is started from its own event loses
timers on FORTE (`triggerTimedFB` of timerha.cpp changes an entry that is waiting again); it goes on afterwards, when
INIT only confirms what is there."""

Ends = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Part:
    """What a resource gets for a link: blocks, each a name, a type and parameters, and connections."""

    blocks: tuple[tuple[str, str, tuple[Ends, ...]], ...]
    events: tuple[Ends, ...]
    data: tuple[Ends, ...]


def queue_type(name: str, events: int, types: Sequence[DataType], file: str, line: int) -> model.BasicFBType:
    """The type of a queue of events with data, first in, first out.

    An event E0, E1, ... with the data D1, D2, ... goes to SEND, where WHICH says which one it is. It leaves the queue
    with DONE; after CLOSED it is sent again with OPENED. NEXT has to be connected with QUEUED.

    Raises:
        FunctionBlockError: data of a type that is not elementary.
    """
    for kind in types:
        if not isinstance(kind, ElementaryType):
            raise FunctionBlockError(f"acknowledged links do not carry {kind}: expected elementary types", file, line)
    numbers = range(1, len(types) + 1)
    inputs = " ".join(f"D{i}" for i in numbers)
    outputs = " ".join(f"O{i}" for i in numbers)
    put = "".join(f"Q{i}[AT] := D{i};\n" for i in numbers)
    take = "".join(f"O{i} := Q{i}[HEAD];\n" for i in numbers)
    texts = {f"E{k}": f"WHO[(HEAD + COUNT) MOD {WAITING}] := {k};" for k in range(events)}
    texts["PUT"] = f"AT := (HEAD + COUNT) MOD {WAITING};\n{put}COUNT := COUNT + 1;"
    texts["OPENED"] = "OPEN := TRUE;\nFREE := TRUE;"
    texts["DONE"] = f"HEAD := (HEAD + 1) MOD {WAITING};\nCOUNT := COUNT - 1;\nFREE := TRUE;"
    texts["CLOSED"] = "OPEN := FALSE;\nFREE := FALSE;"
    texts["NEXT"] = f"WHICH := WHO[HEAD];\n{take}FREE := FALSE;"
    actions: dict[str, tuple[model.ECAction, ...]]
    actions = {f"E{k}": (model.ECAction(f"E{k}"), model.ECAction("PUT", "QUEUED")) for k in range(events)}
    actions |= {event: (model.ECAction(event, "QUEUED"),) for event in ("OPENED", "DONE")}
    actions["CLOSED"] = (model.ECAction("CLOSED"),)
    actions["NEXT"] = (model.ECAction("NEXT", "SEND"),)
    guards = {event: f"COUNT < {WAITING}" if event[0] == "E" else "" for event in actions}
    guards["OPENED"] = "NOT OPEN"
    guards["NEXT"] = "FREE AND COUNT > 0"
    transitions = [model.ECTransition("START", event, event, guard) for event, guard in guards.items()]
    arriving = ", ".join(f"E{k}({inputs})" for k in range(events))
    return model.BasicFBType(
        model.TypeHeader(name, comment="Events that wait for their turn to be sent"),
        interface(
            f"{arriving}, OPENED, DONE, CLOSED, NEXT -> SEND(WHICH {outputs}), QUEUED",
            f"{_declared('D', types)} -> WHICH: UINT; {_declared('O', types)}",
        ),
        variables(
            f"HEAD, COUNT, AT: INT; OPEN, FREE: BOOL; WHO: UINT[{WAITING}]; {_declared('Q', types, f'[{WAITING}]')}"
        ),
        (model.ECState("START"), *(model.ECState(f"AT_{name}", steps) for name, steps in actions.items())),
        tuple(
            one
            for t in transitions
            for one in (replace(t, destination=f"AT_{t.event}"), model.ECTransition(f"AT_{t.event}", "START"))
        ),
        tuple(model.Algorithm(name, model.Source(text)) for name, text in texts.items()),
    )


def _declared(prefix: str, types: Sequence[DataType], size: str = "") -> str:
    return "; ".join(f"{prefix}{i}: {kind}{size}" for i, kind in enumerate(types, 1))


def sender(name: str, queue: str, address: str, events: Sequence[str], data: Sequence[str]) -> Part:
    """The blocks of the sending resource.

    Args:
        name: what their names begin with.
        queue: the type of the queue.
        address: where the receiver listens.
        events: the ports whose events are sent.
        data: the ports whose values are sent.
    """
    client, opened, done, again = (f"{name}_{part}" for part in ("CLIENT", "OPENED", "DONE", "AGAIN"))
    first = 1 + (len(events) > 1)
    blocks = (
        (name, queue, ()),
        (client, f"CLIENT_{len(data) + first - 1}_0", (("QI", "TRUE"), ("ID", f"'{address}'"))),
        (opened, "E_SWITCH", ()),
        (done, "E_SWITCH", ()),
        (again, "E_CYCLE", (("DT", RETRY),)),
    )
    wires = [
        ("START.COLD", f"{client}.INIT"),
        (f"{client}.INITO", f"{opened}.EI"),
        (f"{client}.CNF", f"{done}.EI"),
        (f"{opened}.EO1", f"{name}.OPENED"),
        (f"{done}.EO1", f"{name}.DONE"),
        (f"{done}.EO0", f"{name}.CLOSED"),
        ("START.COLD", f"{again}.START"),
        (f"{again}.EO", f"{client}.INIT"),
        (f"{name}.QUEUED", f"{name}.NEXT"),
        (f"{name}.SEND", f"{client}.REQ"),
        *((event, f"{name}.E{number}") for number, event in enumerate(events)),
    ]
    values = [
        (f"{client}.QO", f"{opened}.G"),
        (f"{client}.QO", f"{done}.G"),
        *([(f"{name}.WHICH", f"{client}.SD_1")] if first > 1 else ()),
        *((port, f"{name}.D{place}") for place, port in enumerate(data, 1)),
        *((f"{name}.O{place}", f"{client}.SD_{place + first - 1}") for place in range(1, len(data) + 1)),
    ]
    return Part(blocks, tuple(wires), tuple(values))


def receiver(name: str, address: str, events: Sequence[Sequence[str]], data: Sequence[Sequence[str]]) -> Part:
    """The blocks of the receiving resource; `events` and `data` are the ports that each of them goes to."""
    which = f"{name}_WHICH"
    several = len(events) > 1
    blocks: list[tuple[str, str, tuple[Ends, ...]]]
    blocks = [(name, f"SERVER_0_{len(data) + several}", (("QI", "TRUE"), ("ID", f"'{address}'")))]
    wires = [("START.COLD", f"{name}.INIT")]
    values = [
        (f"{name}.RD_{place}", destination) for place, ends in enumerate(data, 1 + several) for destination in ends
    ]
    if several:
        blocks.append((which, f"E_DEMUX_{len(events)}", ()))
        wires.append((f"{name}.IND", f"{which}.EI"))
        values.append((f"{name}.RD_1", f"{which}.K"))
    for number, ends in enumerate(events, 1):
        source = f"{which}.EO{number}" if several else f"{name}.IND"
        # the answer comes behind the events, which have read their data when the next ones arrive
        wires += [(source, destination) for destination in (*ends, f"{name}.RSP")]
    return Part(tuple(blocks), tuple(wires), tuple(values))
