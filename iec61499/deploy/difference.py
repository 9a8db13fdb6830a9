"""What a resource on a device has against a plan, and the fewest requests that make it what the plan says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from iec61499.deploy.build import note
from iec61499.deploy.listing import listed
from iec61499.deploy.plan import Deployment
from iec61499.errors import CommunicationError, FunctionBlockError
from iec61499.literals import parse_duration, parse_string
from iec61499.management.client import ManagementClient, Step
from iec61499.management.protocol import (
    ANY,
    EVENT,
    Change,
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    ManagementError,
    Request,
    RequestAction,
)

_PATIENCE: Final = 10_000
"""How often the device is asked to put a change in force while event chains run."""
_DIGITS: Final = 15
"""Digits of a number that a FORTE 2 prints at most."""


@dataclass(frozen=True, slots=True)
class Difference:
    """What must happen to a resource; nothing when every part is empty.

    Attributes:
        removed: blocks to delete, with their connections.
        added: blocks to create; one whose type changes is removed and added.
        cut: connections to delete between blocks that stay.
        made: connections to create.
        written: values to write: literal and port.
        found: what the device has at the ports of `written`, by port; "" at a block that is added.
    """

    removed: tuple[ManagedBlock, ...]
    added: tuple[ManagedBlock, ...]
    cut: tuple[ManagedConnection, ...]
    made: tuple[ManagedConnection, ...]
    written: tuple[ManagedConnection, ...]
    found: dict[str, str]

    def __bool__(self) -> bool:
        return bool(self.removed or self.added or self.cut or self.made or self.written)

    def lines(self) -> list[str]:
        """A line for every part: - what the device has, + what the plan has, ~ a value that is another one."""
        return [
            *(f"- {block.name}: {block.type_name}" for block in self.removed),
            *(f"+ {block.name}: {block.type_name}" for block in self.added),
            *(f"- {wire.source} -> {wire.destination}" for wire in self.cut),
            *(f"+ {wire.source} -> {wire.destination}" for wire in self.made),
            *(
                f"~ {value.destination} is {self.found[value.destination]}, shall be {value.source}"
                for value in self.written
                if self.found[value.destination]
            ),
        ]


def difference(client: ManagementClient, deployment: Deployment) -> Difference:
    """Holds a resource on a device against the plan of it.

    Blocks are compared by name and type, whose name ends with a digest of its code; so the resource must have been
    built by `deploy`.

    Raises:
        ManagementError: the device has no such resource, or refuses.
        CommunicationError: the device does not answer.
    """
    resource = deployment.resource
    if all(block.name != resource for block in client.blocks("")):
        raise ManagementError(
            "INVALID_DST", f"{client.address}: no resource {resource}: expected one built by deploy"
        )
    subjects = [(c.request.action, c.request.subject) for c in deployment.commands if c.resource == resource]
    wanted = {s.name: s for a, s in subjects if a == "CREATE" and isinstance(s, ManagedBlock)}
    wires = {(s.source, s.destination): s for a, s in subjects if a == "CREATE" and isinstance(s, ManagedConnection)}
    values = [s for a, s in subjects if a == "WRITE" and isinstance(s, ManagedConnection)]
    found_there = listed(client, resource)
    there = {name: ManagedBlock(name, kind) for name, kind in found_there.blocks}
    links = [ManagedConnection(source, destination) for source, destination in found_there.connections]
    removed = tuple(block for name, block in there.items() if wanted.get(name) != block)
    added = tuple(block for name, block in wanted.items() if there.get(name) != block)
    gone = {block.name for block in removed}
    staying = {
        (link.source, link.destination): link
        for link in links
        if not {link.source.rpartition(".")[0], link.destination.rpartition(".")[0]} & gone
    }
    cut = tuple(link for ends, link in staying.items() if ends not in wires)
    made = tuple(wire for ends, wire in wires.items() if ends not in staying)
    new = {block.name for block in added}
    old = [value.destination for value in values if value.destination.rpartition(".")[0] not in new]
    ports = [port for port in old if port not in deployment.typed]
    read = dict(zip(ports, client.read_all((resource, port) for port in ports), strict=True))
    found: dict[str, str] = {}
    written = []
    for value in values:
        port = value.destination
        if port.rpartition(".")[0] in new or (port in read and not _is_same(value.source, read[port])):
            written.append(value)
            found[port] = read.get(port, "")
    return Difference(removed, added, cut, made, tuple(written), found)


def change(client: ManagementClient, deployment: Deployment) -> Difference:
    """Makes a resource that runs what the plan says, with the fewest requests; returns what was changed.

    What stays keeps its state. A block that is added begins with its initial values, and gets no event of E_RESTART.
    A device that gathers changes makes all of them between two events, or none, and lets a block that takes the place
    of another one go on with its values. On others that block gets the event INIT, and when a request is refused,
    those before it are undone.

    Raises:
        ManagementError: the device refuses; names the request and what could not be undone.
        CommunicationError: the device does not answer; says how many requests were fulfilled at least, which are not
            undone.
    """
    resource = deployment.resource
    found = difference(client, deployment)
    restoring = _restoring(client, deployment, found)
    gone = {block.name for block in found.removed}
    ends = listed(client, resource).connections
    loose = [ManagedConnection(*pair) for pair in ends if gone & {end.rpartition(".")[0] for end in pair}]
    if client.request(resource, "CREATE", Change()).reason is None:
        _change_at_once(client, resource, _steps(deployment, found, loose, ()))
    else:
        triggered = _initialised(deployment, found)
        _change_step_by_step(client, _steps(deployment, found, loose, triggered), restoring)
    note(client, deployment)
    left = difference(client, deployment)
    if left:
        raise ManagementError(
            "INVALID_STATE", f"{client.address}: {resource} has after the change: {left.lines()[0]}"
        )
    return found


def _steps(
    deployment: Deployment, found: Difference, loose: Sequence[ManagedConnection], triggered: Sequence[str]
) -> list[Step]:
    """The requests of a change.

    Args:
        deployment: the plan.
        found: what is different.
        loose: the connections of blocks that go, which a FORTE 2 does not delete with them.
        triggered: events to trigger before what the blocks issue is connected.
    """
    resource = deployment.resource
    steps: list[Step] = []
    needed = {block.type_name for block in found.added}
    for command in deployment.commands:
        subject = command.request.subject
        if isinstance(subject, ManagedType) and subject.name in needed:
            steps.append(("", "CREATE", subject))
    steps += [(resource, "DELETE", wire) for wire in (*loose, *found.cut)]
    for block in found.removed:
        steps += [(resource, "STOP", block), (resource, "DELETE", block)]
    steps += [(resource, "CREATE", block) for block in found.added]
    steps += [(resource, "WRITE", value) for value in found.written]
    steps += [(resource, "START", block) for block in found.added]
    steps += [(resource, "WRITE", ManagedConnection(EVENT, event)) for event in triggered]
    steps += [(resource, "CREATE", wire) for wire in found.made]
    return steps


def _initialised(deployment: Deployment, found: Difference) -> list[str]:
    """The event INIT of every block that takes the place of one, where something is connected to it."""
    replaced = {block.name for block in found.added} & {block.name for block in found.removed}
    subjects = [command.request.subject for command in deployment.commands]
    ends = dict.fromkeys(subject.destination for subject in subjects if isinstance(subject, ManagedConnection))
    return [end for end in ends if end.rpartition(".")[2] == "INIT" and end.rpartition(".")[0] in replaced]


def _change_at_once(client: ManagementClient, resource: str, steps: list[Step]) -> None:
    """Carries out requests that the device has begun to gather, all or none."""
    try:
        for _ in client.demand_all(steps):
            pass
        for _ in range(_PATIENCE):
            response = client.request(resource, "START", Change())
            if response.reason != "NOT_READY":
                break
        if response.reason is not None:
            raise ManagementError(response.reason, f"{client.address}: {response.detail or response.reason}")
    except ManagementError as error:
        client.request(resource, "DELETE", Change())
        raise ManagementError(error.reason, f"{error}; {resource} goes on as before the change") from None


def _change_step_by_step(client: ManagementClient, steps: list[Step], restoring: list[Step]) -> None:
    """Carries out requests one after another, and takes back those before one that is refused."""
    count = 0
    try:
        for _ in client.demand_all(steps):
            count += 1
    except ManagementError as error:
        raise ManagementError(error.reason, f"{error}; {_undo(client, steps[:count], restoring)}") from None
    except CommunicationError as error:
        text = f"{error}; at least {count} of {len(steps)} requests were fulfilled and stay so"
        raise CommunicationError(text) from None


def _restoring(client: ManagementClient, deployment: Deployment, found: Difference) -> list[Step]:
    """What gives the blocks and ports that a change touches the values that they have now."""
    resource = deployment.resource
    gone = {block.name for block in found.removed}
    values: list[Step] = []
    for command in deployment.commands:
        subject = command.request.subject
        if command.request.action != "WRITE" or not isinstance(subject, ManagedConnection):
            continue
        port = subject.destination
        text = found.found.get(port)
        if command.resource == resource and port.rpartition(".")[0] in gone:
            # the block that is there may be of another type, without this port
            text = client.request(resource, "READ", ManagedConnection(port, ANY)).value
        if text:
            # a FORTE prints 15 digits of a number, which may have more
            literal = subject.source if _is_same(subject.source, text) else _literal(text, subject.source)
            values.append((resource, "WRITE", ManagedConnection(literal, port)))
    return values


def _undo(client: ManagementClient, done: list[Step], restoring: list[Step]) -> str:
    """Takes back what was done, the last first; says what came of it."""
    inverse: dict[RequestAction, RequestAction] = {"CREATE": "DELETE", "DELETE": "CREATE", "START": "STOP"}
    taken_back: list[Step] = [
        (where, inverse[action], subject)
        for where, action, subject in reversed(done)
        if action in inverse and not isinstance(subject, ManagedType)
    ]
    deleted = {
        subject.name for _, action, subject in done if action == "DELETE" and isinstance(subject, ManagedBlock)
    }
    written = {subject.destination for _, action, subject in done if isinstance(subject, ManagedConnection)}
    for step in restoring:
        subject = step[2]
        assert isinstance(subject, ManagedConnection)
        ends = {subject.source.rpartition(".")[0], subject.destination.rpartition(".")[0]}
        if ends & deleted or (step[1] == "WRITE" and subject.destination in written):
            taken_back.append(step)
    taken_back += [(where, "START", subject) for where, action, subject in done if action == "STOP"]
    responses = zip(taken_back, client.request_all(taken_back), strict=True)
    refused = [str(Request("", step[1], step[2])) for step, response in responses if response.reason is not None]
    if refused:
        return f"of the change before it could not be undone: {', '.join(refused)}"
    anew = f"; {', '.join(sorted(deleted))} begins anew" if deleted else ""
    return f"the change before it was undone{anew}"


def _literal(printed: str, like: str) -> str:
    """A value that a device has printed as a literal; of a text when it is like one."""
    quote = like[:1] if like[:1] in ("'", '"') else ""
    if quote and _text(printed) is not None:
        return printed
    return f"{quote}{printed.replace('$', '$$').replace(quote, '$' + quote)}{quote}" if quote else printed


def _text(printed: str) -> str | None:
    """The text of a literal in quotes, as `fb run` prints one with control characters; None for what is none."""
    if len(printed) < 2 or printed[0] not in "'\"" or printed[-1] != printed[0]:
        return None
    try:
        return parse_string(printed)
    except FunctionBlockError:
        return None


def _is_same(literal: str, printed: str) -> bool:
    """Whether a device prints the value of a literal so."""
    quoted = literal[:1] in ("'", '"')
    if quoted and _text(printed) is not None and _text(printed) == _text(literal):
        return True
    bare = literal[1:-1] if quoted else literal.rpartition("#")[2] if "#" in literal else literal
    if quoted or bare == printed or literal == printed:
        return bare.replace("$$", "$") == printed or literal == printed
    durations = [parse_duration(text.partition("#")[2]) for text in (literal, printed) if "#" in text]
    if len(durations) == 2 and None not in durations:
        return durations[0] == durations[1]
    try:
        wanted, found = float(bare), float(printed.rpartition("#")[2])
        return wanted == found or (len(printed) > _DIGITS and float(f"{wanted:.{_DIGITS}g}") == found)
    except ValueError:
        return bare.upper() == printed.upper()
