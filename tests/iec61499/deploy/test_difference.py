"""A device held against a system, and changed to it while it runs."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import pytest

from dtwin.controller.ports import EMULATOR
from dtwin.errors import CommunicationError
from dtwin.parameters import ROOT
from iec61499.deploy.build import deploy
from iec61499.deploy.difference import Difference, change, difference
from iec61499.deploy.plan import Deployment, plan_deployment
from iec61499.library import Library
from iec61499.management.bootfile import Command
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import (
    Change,
    ManagedBlock,
    ManagedConnection,
    ManagementError,
    Request,
    RequestAction,
    Response,
    Subject,
)
from iec61499.mapping import device_network, resource_network
from iec61499.net.address import LOOPBACK, Address
from iec61499.net.client import BlockingClient
from iec61499.runtime.resource import Resource
from tests.support.iec61499.served_device import PATIENCE, ServedDevice, samples

PORTS = dict.fromkeys(range(61500, 61507), 0)


@pytest.fixture
def library(tmp_path: Path) -> Library:
    return Library([ROOT / "fb"])


def plan(library: Library, text: str, tmp_path: Path) -> Deployment:
    file = tmp_path / "cell.sys"
    file.write_text(text)
    return plan_deployment("CELL", device_network(library.load_system(file)), library, PORTS)


def test_the_smallest_change_is_made_while_the_cell_runs(served: ServedDevice, tmp_path: Path) -> None:
    text = (ROOT / "fb" / "dtwin.sys").read_text()
    before = plan(served.library, text, tmp_path)
    block = '<FB Name="SEQUENCE" Type="PICK_AND_PLACE"'
    assert text.count(block) >= 1
    more = text.replace(block, '<FB Name="EXTRA" Type="E_CTU"><Parameter Name="PV" Value="7"/></FB>' + block)
    more = more.replace('Name="KP1" Value="559.0"', 'Name="KP1" Value="560.0"')
    more = more.replace('From="', 'From="', 1)
    first = text.index("<Mapping ")
    mapping = text[first : text.index("/>", first) + 2]
    owner = mapping.split('From="')[1].split('"')[0].partition(".")
    extra = mapping.replace(f"{owner[0]}.{owner[2]}", f"{owner[0]}.EXTRA")
    after = plan(served.library, more.replace(mapping, mapping + extra, 1), tmp_path)
    with served.client() as client:
        with pytest.raises(CommunicationError, match="no resource CELL: expected one built by deploy"):
            difference(client, before)
        deploy(client, before)
        assert not difference(client, before)
        where = served.device.addresses()["CELL.EMULATOR"]
        with BlockingClient(where, EMULATOR.receives, EMULATOR.sends, PATIENCE) as peer:
            for sample in samples(50):
                peer.exchange(sample)
            found = difference(client, after)
            assert sorted(found.lines()) == ["+ CELL.EXTRA: E_CTU", "~ CELL.CONTROLLER.KP1 is 559.0, shall be 560.0"]
            assert change(client, after) == found
            assert not difference(client, after)
            for sample in samples(50):
                peer.exchange(sample)
        assert client.read("CELL", "CELL.EXTRA.PV") == "7"
        client.connect("CELL", "CELL.SEQUENCE.CNF", "CELL.EXTRA.CU")
        assert change(client, before).lines() == [
            "- CELL.EXTRA: E_CTU",
            "~ CELL.CONTROLLER.KP1 is 560.0, shall be 559.0",
        ]
        links = client.demand("CELL", "QUERY", ManagedConnection("*", "*")).connections or ()
        assert all("CELL.EXTRA" not in link.destination for link in links)


class StepByStep(ManagementClient):
    """A session with a device that gathers no changes, as a FORTE."""

    def request(self, resource: str, action: RequestAction, subject: Subject | None = None) -> Response:
        if isinstance(subject, Change):
            return Response("", "INVALID_OBJECT")
        return super().request(resource, action, subject)


@pytest.mark.parametrize("lost", ["", "; CELL.SELECTOR begins anew"])
@pytest.mark.parametrize("at_once", [True, False])
def test_a_refused_change_is_undone(served: ServedDevice, tmp_path: Path, lost: str, at_once: bool) -> None:
    text = (ROOT / "fb" / "dtwin.sys").read_text()
    before = plan(served.library, text, tmp_path)
    block = Command("CELL", Request("1", "CREATE", ManagedBlock("CELL.EXTRA", "E_CTU")))
    value = Command("CELL", Request("1", "WRITE", ManagedConnection("7", "CELL.EXTRA.PV")))
    first = Command("CELL", Request("1", "CREATE", ManagedConnection("CELL.SEQUENCE.CNF", "CELL.EXTRA.CU")))
    wrong = Command("CELL", Request("1", "CREATE", ManagedConnection("CELL.SEQUENCE.CNF", "CELL.EXTRA.NONE")))
    commands = []
    for command in before.commands:
        subject = command.request.subject
        if isinstance(subject, ManagedBlock) and lost and subject.name == "CELL.SELECTOR":
            command = Command("CELL", Request("1", "CREATE", ManagedBlock("CELL.SELECTOR", "E_SELECT")))
        if subject == ManagedConnection("200.0", "CELL.CONTROLLER.KP1") and not lost:
            command = Command("CELL", Request("1", "WRITE", ManagedConnection("201.0", "CELL.CONTROLLER.KP1")))
        ends = (subject.source, subject.destination) if isinstance(subject, ManagedConnection) else ()
        if not (lost and any("CELL.SELECTOR." in end for end in ends)):
            commands.append(command)
    after = replace(before, commands=(*commands, block, value, first, wrong))
    address = served.management.address
    said = "CELL goes on as before the change" if at_once else f"the change before it was undone{lost}"
    with ManagementClient(address, PATIENCE) if at_once else StepByStep(address, PATIENCE) as client:
        deploy(client, before)
        with pytest.raises(ManagementError, match=f"{said}$"):
            change(client, after)
        assert difference(client, before).lines() == []
        assert all(found.name != "CELL.EXTRA" for found in client.blocks("CELL"))
        where = served.device.addresses()["CELL.EMULATOR"]
        with BlockingClient(where, EMULATOR.receives, EMULATOR.sends, PATIENCE) as peer:
            for sample in samples(3):
                peer.exchange(sample)


def test_a_type_changes_while_the_cell_runs_at_full_speed(tmp_path: Path) -> None:
    """The type means the same and is another one; every sample gets the answer that it gets without the change."""
    blocks = tmp_path / "fb"
    blocks.mkdir()
    for file in (ROOT / "fb").glob("*.fbt"):
        (blocks / file.name).write_text(file.read_text())
    text = (ROOT / "fb" / "dtwin.sys").read_text()
    served = ServedDevice(Library([blocks]), Address(LOOPBACK, 0))
    before = plan(served.library, text, tmp_path)
    for name in ("COMPUTED_TORQUE_CONTROL_3", "PICK_AND_PLACE"):
        file = blocks / f"{name}.fbt"
        source = file.read_text()
        spare = '<InternalVars><VarDeclaration Name="SPARE" Type="LREAL"/>'
        changed = source.replace("<InternalVars>", spare)
        assert changed != source
        file.write_text(changed)
    after = plan(Library([blocks]), text, tmp_path)
    expected = Resource(
        resource_network(Library([ROOT / "fb"]).load_system(ROOT / "fb" / "dtwin.sys")), served.library
    )
    alone = expected.server("EMULATOR")
    expected.start()
    served.start()
    try:
        with served.client() as client:
            deploy(client, before)
            where = served.device.addresses()["CELL.EMULATOR"]
            with BlockingClient(where, EMULATOR.receives, EMULATOR.sends, PATIENCE) as peer:
                outcome: list[Difference] = []
                changing = threading.Thread(target=lambda: outcome.append(change(client, after)))
                for count, sample in enumerate(samples(3000), 1):
                    if count == 20:
                        changing.start()
                    assert peer.exchange(sample) == alone.exchange(sample)
                    if count > 100 and not changing.is_alive():
                        break
                changing.join(PATIENCE)
                assert {block.name for block in outcome[0].removed} == {"CELL.CONTROLLER", "CELL.SEQUENCE"}
                for sample in samples(30):
                    assert peer.exchange(sample) == alone.exchange(sample)
            assert not difference(client, after)
    finally:
        served.stop()


def test_a_change_that_the_network_does_not_bear_changes_nothing(served: ServedDevice, tmp_path: Path) -> None:
    before = plan(served.library, (ROOT / "fb" / "dtwin.sys").read_text(), tmp_path)
    with served.client() as client:
        deploy(client, before)
        client.demand("CELL", "CREATE", Change())
        client.create_block("CELL", "ODD", "F_ADD")
        client.create_block("CELL", "TEXT", "STRING2STRING")
        client.connect("CELL", "TEXT.OUT", "ODD.IN1")
        with pytest.raises(ManagementError, match=r"refused START change: INVALID_OPERATION, .*ODD") as refused:
            client.demand("CELL", "START", Change())
        assert refused.value.reason == "INVALID_OPERATION"
        assert not difference(client, before)
