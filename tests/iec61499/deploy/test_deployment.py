"""Deployment: the flat network does what the nested one does, and what a device refuses is named."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dtwin.errors import FunctionBlockError
from dtwin.parameters import ROOT
from iec61499 import model
from iec61499.deploy.build import deploy
from iec61499.deploy.plan import Deployment, plan_deployment
from iec61499.device.embedded import EmbeddedDevice
from iec61499.library import Library
from iec61499.management.bootfile import Command, parse_boot_file, print_boot_file
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import (
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    ManagementError,
    Reason,
    Request,
    Response,
)
from iec61499.management.server import ManagementServer
from iec61499.mapping import resource_network
from iec61499.net.address import LOOPBACK, Address
from iec61499.net.reactor import Reactor
from iec61499.runtime.resource import Resource
from iec61499.standard.notation import interface
from iec61499.types import LREAL
from tests.support.iec61499.networks import Types, chart, network

BLOCKS = ROOT / "fb"


def cell_network(library: Library) -> model.FBNetwork:
    return resource_network(library.load_system(BLOCKS / "dtwin.sys"))


def flat(deployment: Deployment) -> Resource:
    """The deployed resource as the embedded runtime executes it."""
    library = Types(*(lua.block for lua in deployment.types))
    blocks = {"START": "E_RESTART"}
    links: list[model.Connection] = []
    written: dict[str, str] = {}
    for command in deployment.commands:
        match command.request.subject:
            case ManagedBlock(name, kind) if command.resource:
                blocks[name] = kind
            case ManagedConnection(source, destination) if command.request.action == "WRITE":
                written[destination] = source
            case ManagedConnection(source, destination):
                links.append(model.Connection(source, destination))
    inputs = {
        f"{name}.{variable.name}" for name, kind in blocks.items() for variable in library.find(kind).interface.inputs
    }
    parameters: dict[str, list[model.Parameter]] = {}
    for place, literal in written.items():
        if place in inputs:
            block, _, port = place.rpartition(".")
            parameters.setdefault(block, []).append(model.Parameter(port, literal))
    events: list[model.Connection] = []
    data: list[model.Connection] = []
    for link in links:
        block, _, port = link.source.rpartition(".")
        outputs = library.find(blocks[block]).interface.event_outputs
        (events if port in [event.name for event in outputs] else data).append(link)
    made = tuple(model.Block(name, kind, tuple(parameters.get(name, ()))) for name, kind in blocks.items())
    resource = Resource(model.FBNetwork(made, (), tuple(events), tuple(data)), library)
    for place in written.keys() - inputs:
        resource.write(place, model.literal(written[place], resource.variable_type(place)))
    return resource


def written(deployment: Deployment) -> dict[str, str]:
    subjects = [c.request.subject for c in deployment.commands if c.request.action == "WRITE"]
    return {subject.destination: subject.source for subject in subjects if isinstance(subject, ManagedConnection)}


class AnsweredApplication:
    """The cell's application; the test gives it samples and watches the twin's ports."""

    def __init__(self, resource: Resource) -> None:
        self.resource = resource
        self.sent: list[tuple[Any, ...]] = []
        self._exchange = resource.server("EMULATOR").exchange
        for port in ("TWIN.IDENTIFICATION.BLOCK.DATA", "TWIN.MONITORING.DATA"):
            resource.port(port).attach(self.sent.append)
        resource.start()

    def tick(self, sample: tuple[Any, ...]) -> tuple[Any, ...]:
        return self._exchange(sample)

    def receive(self, port: str, values: tuple[Any, ...]) -> None:
        self.resource.port(f"TWIN.{port}").deliver(values)
        self.resource.run_until_idle()


def test_the_cell_laid_flat_answers_as_the_cell() -> None:
    library = Library([BLOCKS])
    generator = np.random.default_rng(1)
    cells = [
        AnsweredApplication(Resource(cell_network(library), library)),
        AnsweredApplication(flat(plan_deployment("R", cell_network(library), library))),
    ]
    received: dict[int, tuple[str, tuple[Any, ...]]] = {
        40: ("IDENTIFICATION.REQUEST", (True,)),
        90: ("SIMULATION.GAIN_PORT", tuple(generator.uniform(1, 100, 10))),
        100: ("IDENTIFICATION.REQUEST", (False,)),
        130: ("SIMULATION.MODEL_PORT", tuple(generator.uniform(0.1, 0.3, 21))),
        150: ("IDENTIFICATION.REQUEST", (True,)),
    }
    theta = np.zeros(3)
    for tick in range(600):
        theta = theta + generator.uniform(-0.01, 0.01, 3)
        if tick in received:
            for cell in cells:
                cell.receive(*received[tick])
        sample = (*map(float, theta), 0.9, tick % 100 > 50, "red")
        one, other = (cell.tick(sample) for cell in cells)
        assert one == other
    assert cells[0].sent == cells[1].sent
    assert len(cells[0].sent) > 400


ADDER = chart(
    "ADDER",
    "E(X OFFSET) -> DONE(Y)",
    "X, OFFSET: LREAL -> Y: LREAL",
    {"START": [], "ADD": [("Y := X + OFFSET + K; K := 0.5;", "DONE")]},
    [("START", "E", "ADD"), ("ADD", "1", "START")],
)


def adder(**initial: str) -> model.BasicFBType:
    def given(variables: tuple[model.Variable, ...]) -> tuple[model.Variable, ...]:
        return tuple(model.Variable(v.name, v.type, initial.get(v.name, "")) for v in variables)

    k = model.Variable("K", ADDER.interface.inputs[0].type, initial.get("K", ""))
    ports = model.Interface(
        ADDER.interface.event_inputs,
        ADDER.interface.event_outputs,
        given(ADDER.interface.inputs),
        given(ADDER.interface.outputs),
    )
    return model.BasicFBType(ADDER.header, ports, (k,), ADDER.states, ADDER.transitions, ADDER.algorithms)


def composite(name: str, events: str, data: str, body: model.FBNetwork) -> model.CompositeFBType:
    return model.CompositeFBType(model.TypeHeader(name), interface(events, data), body)


def both(found: model.FBNetwork, library: Library) -> tuple[Resource, Resource, Deployment]:
    """The network and the same network laid flat, both started."""
    deployment = plan_deployment("R", found, library)
    resources = Resource(found, library), flat(deployment)
    for resource in resources:
        resource.start()
    return *resources, deployment


def test_inputs_of_a_composite_are_sampled_at_its_border() -> None:
    inner = network("A: ADDER", "GO -> A.E; A.DONE -> DONE", "X -> A.X; A.Y -> Y")
    body = composite("BOX", "LOOK(X), GO -> DONE(Y)", "X: LREAL -> Y: LREAL", inner)
    given = {f"{name}.QI": "TRUE" for name in ("I", "J")} | {"I.ID": "'I'", "J.ID": "'J'"}
    found = network(
        "START: E_RESTART; I: SUBSCRIBE_1; J: SUBSCRIBE_0; B: BOX",
        "START.COLD -> I.INIT; START.COLD -> J.INIT; I.IND -> B.LOOK; J.IND -> B.GO",
        "I.RD_1 -> B.X",
        given,
    )
    nested, laid, _ = both(found, Types(adder(), body))
    for resource, y in ((nested, "B.Y"), (laid, "B.BORDER.Y")):
        seen = []
        for port, values in (("I", (2.0,)), ("J", ()), ("I", (3.0,)), ("I", (4.0,)), ("J", ())):
            resource.port(port).deliver(values)
            resource.run_until_idle()
            seen.append(resource.read(y))
        assert seen == [0.0, 2.0, 2.0, 2.0, 4.5]


def test_values_that_enter_from_no_connection_go_to_the_blocks_inside() -> None:
    inner = composite(
        "INNER",
        "E(X N) -> DONE(Y)",
        "X: LREAL; N: INT -> Y: LREAL",
        network(
            "A: ADDER; B: ADDER",
            "E -> A.E; A.DONE -> B.E; B.DONE -> DONE",
            "X -> A.X; N -> A.OFFSET; A.Y -> B.X; B.Y -> Y",
        ),
    )
    outer = composite(
        "OUTER",
        "E(X N) -> DONE(Y)",
        "X: LREAL; N: INT -> Y: LREAL",
        network("C: INNER", "E -> C.E; C.DONE -> DONE", "X -> C.X; N -> C.N; C.Y -> Y"),
    )
    found = network("START: E_RESTART; O: OUTER", "START.COLD -> O.E", "", {"O.X": "1.5", "O.N": "7"})
    nested, laid, deployment = both(found, Types(adder(K="100.0", OFFSET="0.25", Y="-1.0"), inner, outer))
    assert nested.read("O.Y") == laid.read("O.BORDER.Y") == 1.5 + 7 + 100 + 0.25 + 100
    values = written(deployment)
    assert values["O.C.A.X"] == "1.5"
    assert values["O.C.A.OFFSET"] == "7.0"
    assert values["O.C.B.OFFSET"] == "0.25"
    assert values["O.C.A.K"] == values["O.C.B.K"] == "100.0"
    assert values["O.C.A.Y"] == "-1.0"
    assert not [place for place in values if "BORDER" in place]


def test_where_ports_of_generic_types_meet_a_value_tells_the_type_before_they_are_connected() -> None:
    block = model.Block("S", "SUBSCRIBE_1", types=(("RD_1", LREAL),))
    made = replace(network("P: PUBLISH_1", "S.IND -> P.REQ", "S.RD_1 -> P.SD_1"), file="x.sys")
    found = replace(made, blocks=(block, *made.blocks))
    deployment = plan_deployment("R", found, Library())
    requests = [str(command.request) for command in deployment.commands]
    assert requests.index("WRITE LREAL#0.0 to P.SD_1") < requests.index("CREATE S.RD_1 -> P.SD_1")
    assert deployment.typed == {"P.SD_1"}


def test_literals_for_generic_ports_carry_their_type_and_ids_their_new_port() -> None:
    found = network(
        "START: E_RESTART; S: SERVER_2_1; F: F_ADD",
        "START.COLD -> S.INIT",
        "",
        {
            "S.QI": "TRUE",
            "S.ID": "'localhost:61500'",
            "S.SD_1": "'it$'s'",
            "S.SD_2": "T#5s",
            "F.IN1": "2.5",
            "F.IN2": "LREAL#1",
        },
    )
    values = written(plan_deployment("R", found, Library(), {61500: 1234, 61501: 5}))
    assert values == {
        "S.QI": "TRUE",
        "S.ID": '"localhost:1234"',
        "S.SD_1": "STRING#'it$'s'",
        "S.SD_2": "TIME#5s",
        "F.IN1": "LREAL#2.5",
        "F.IN2": "LREAL#1.0",
    }


def test_border_names_that_are_taken_are_refused() -> None:
    body = network("BORDER: ADDER", "E -> BORDER.E")
    box = composite("BOX", "E -> DONE", "", body)
    with pytest.raises(
        FunctionBlockError, match=r"block B\.BORDER: expected another name, as the border of B takes this one"
    ):
        plan_deployment("R", network("START: E_RESTART; B: BOX"), Types(adder(), box))
    box = composite("BOX", "E, INNER_E -> DONE", "", network(""))
    with pytest.raises(FunctionBlockError, match="port INNER_E of BOX: expected another name"):
        plan_deployment("R", network("START: E_RESTART; B: BOX"), Types(box))


def test_a_boot_file_holds_the_same_requests() -> None:
    library = Library([BLOCKS])
    commands = plan_deployment("EMB_RES", cell_network(library), library).commands
    read = parse_boot_file(print_boot_file(commands))

    def stripped(command: Command) -> tuple[str, str, str]:
        return command.resource, command.request.id, command.request.xml().replace("\n<", "<")

    assert list(map(stripped, read)) == list(map(stripped, commands))


FREE = dict.fromkeys(range(61500, 61506), 0)
"""Ports that the operating system chooses."""


@contextmanager
def session(
    refuse: Callable[[str], bool] = lambda request: False, reason: Reason = "UNSUPPORTED_CMD"
) -> Iterator[ManagementClient]:
    """A session with an embedded device that has the project's library and refuses some requests."""
    with Reactor() as reactor:
        device = EmbeddedDevice(reactor, Library([BLOCKS]), Address(LOOPBACK, 0))

        def handle(resource: str, request: Request, answer: Callable[[Response | Exception], None]) -> None:
            if refuse(request.xml()):
                answer(Response(request.id, reason))
            else:
                device.handle(resource, request, answer)

        server = ManagementServer(reactor, Address(LOOPBACK, 0), handle)
        thread = threading.Thread(target=reactor.run)
        thread.start()
        try:
            with ManagementClient(server.address, 10.0) as client:
                yield client
        finally:
            reactor.stop()
            thread.join(10.0)
            server.close()
            device.close()


def cell_plan(resource: str = "EMB_RES") -> Deployment:
    library = Library([BLOCKS])
    return plan_deployment(resource, cell_network(library), library, FREE)


def test_a_second_deployment_takes_the_place_of_the_first() -> None:
    with session() as client:
        deploy(client, cell_plan())
        client.write("EMB_RES", "PLANNER.T", "9.0")
        client.stop("EMB_RES")
        deploy(client, cell_plan())
        assert client.read("EMB_RES", "PLANNER.T") == "2.0"
        deploy(client, cell_plan("OTHER"))
        deploy(client, cell_plan())
        assert client.read("EMB_RES", "EMULATOR.STATUS") == "OK"
        assert [block.name for block in client.blocks("")] == ["OTHER", "EMB_RES"]


def test_types_that_the_device_knows_are_not_sent_again() -> None:
    sent: list[str] = []

    def note(request: str) -> bool:
        sent.append(request)
        return False

    with session(note) as client:
        for count in (15, 0):
            sent.clear()
            deploy(client, cell_plan())
            assert sum('"CREATE"' in request and "<FBType" in request for request in sent) == count


def test_a_type_that_the_device_has_otherwise_is_refused() -> None:
    library = Library([BLOCKS])
    changed = library.find("DATA_SELECTOR")
    assert isinstance(changed, model.BasicFBType)
    library.add(replace(changed, algorithms=changed.algorithms[::-1]))
    with session() as client, pytest.raises(ManagementError) as refused:
        deploy(client, plan_deployment("EMB_RES", cell_network(library), library, FREE))
    assert "refused type DATA_SELECTOR_" in str(refused.value)
    assert "of block SELECTOR: UNSUPPORTED_TYPE" in str(refused.value)


def test_a_device_without_lua_keeps_what_it_runs() -> None:
    with session(lambda request: "<FBType" in request) as client:
        client.create_block("", "EMB_RES", "EMB_RES")
        with pytest.raises(ManagementError) as refused:
            deploy(client, cell_plan())
        assert [block.name for block in client.blocks("")] == ["EMB_RES"]
    assert "refused type RESTART_DETECTOR_" in str(refused.value)
    assert "of block DETECTOR: UNSUPPORTED_CMD: the device takes no block types" in str(refused.value)
    assert "FORTE_USE_LUATYPES" in str(refused.value)


def test_a_standard_type_that_is_missing_is_named_and_nothing_is_left() -> None:
    with session(lambda request: 'Type="E_SWITCH"' in request, "UNSUPPORTED_TYPE") as client:
        with pytest.raises(
            ManagementError, match=r"refused block TWIN\.MONITORING\.GATE: the device has no type E_SWITCH"
        ):
            deploy(client, cell_plan())
        assert client.blocks("") == ()


def test_another_refusal_names_the_request() -> None:
    with session(lambda request: 'Source="2.0"' in request, "BAD_PARAMS") as client:
        with pytest.raises(
            ManagementError, match=r"refused WRITE 2\.0 to PLANNER\.T in resource EMB_RES: BAD_PARAMS"
        ):
            deploy(client, cell_plan())
        assert client.blocks("") == ()


def test_an_exported_type_needs_its_original() -> None:
    with session() as client:
        for name in ("UNKNOWN_01234567", "SERVER_1_1_01234567", "NOPE"):
            assert client.request("", "CREATE", ManagedType(name, "return 1")).reason == "UNSUPPORTED_TYPE"


def test_values_of_outputs_and_internals_can_be_set_before_the_start() -> None:
    with session() as client:
        client.create_block("", "R", "EMB_RES")
        client.create_block("R", "COUNTER", "EVENT_COUNTER")
        client.create_block("R", "PLANNER", "PATH_PLANNER")
        client.write("R", "COUNTER.COUNT", "7")
        client.write("R", "PLANNER.MOVING", "TRUE")
        assert client.read("R", "COUNTER.COUNT") == "7"
        client.start("R")
        assert client.read("R", "COUNTER.COUNT") == "7"
        assert client.read("R", "PLANNER.MOVING") == "TRUE"
