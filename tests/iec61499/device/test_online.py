"""What 4diac IDE does with a device that runs: watches, events, forced ports, types, and changes of the network."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import BLOCKS, EMULATOR, SYSTEM, on_device
from dtwin.controller.remote import RemoteController, Shadow
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings, sequence_of
from dtwin.signals import Sensors, Voltages
from evidence.bench.blocks import neutral_change
from iec61499 import model
from iec61499.device.drawn_network import DrawnNetwork
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import (
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    Request,
    Watch,
    Watched,
    parse_request,
)
from iec61499.net.address import StreamAddress
from tests.support.driven import DEPLOYED
from tests.support.iec61499.served_device import DOUBLING, PATIENCE, ServedDevice, build, wait_for

COUNTING = "N E_CTU PV=100\nM E_CTU PV=100\nF E_D_FF\nSTART.COLD -> N.CU\nN.CUO -> M.CU\nN.Q -> F.D"


@pytest.fixture
def counting(either: ManagementClient) -> ManagementClient:
    build(either, "R", COUNTING)
    either.start("R")
    wait_for(either, "R", "M.CV", lambda value: value == "1")
    return either


def test_an_event_is_triggered_at_an_input_and_at_an_output(counting: ManagementClient) -> None:
    counting.trigger("R", "N.CU")
    wait_for(counting, "R", "M.CV", lambda value: value == "2")
    counting.trigger("R", "N.CUO")
    wait_for(counting, "R", "M.CV", lambda value: value == "3")
    assert counting.read("R", "N.CV") == "2"
    assert counting.request("R", "WRITE", ManagedConnection("$e", "N.NONE")).reason == "NO_SUCH_OBJECT"


def test_an_event_is_triggered_inside_a_composite_block() -> None:
    library = Library([BLOCKS])
    drawn = DrawnNetwork("R", library, model.FBNetwork())
    drawn.create_block("TWIN", "DIGITAL_TWIN")
    assert drawn.is_event("TWIN.SIMULATION.GAIN_PORT.INIT")
    assert not drawn.is_event("TWIN.SIMULATION.GAIN_PORT.NONE")
    assert not drawn.is_event("TWIN.NONE.GAIN_PORT.INIT")
    assert not drawn.is_event("NONE.SIMULATION.GAIN_PORT.INIT")


def test_the_device_tells_the_watches_of_all_resources_and_counts_events(counting: ManagementClient) -> None:
    build(counting, "Q", "N E_CTU PV=3")
    for resource, name in (("R", "N.CV"), ("R", "N.CU"), ("R", "N.CUO"), ("Q", "N.PV")):
        counting.watch(resource, name)
    before = counting.demand("", "READ", Watch()).watches
    assert before is not None
    assert before["Q"] == {"N.PV": Watched("3")}
    assert before["R"]["N.CV"] == Watched("1")
    for _ in range(3):
        counting.trigger("R", "N.CU")
    wait_for(counting, "R", "N.CV", lambda value: value == "4")
    after = counting.demand("", "READ", Watch()).watches
    assert after is not None
    for event in ("N.CU", "N.CUO"):
        assert after["R"][event].is_event
        assert int(after["R"][event].value) - int(before["R"][event].value) == 3
    counting.demand("R", "WRITE", ManagedConnection("$er", "N.CU"))
    assert counting.watched("R")["N.CU"] == "0"
    counting.demand("R", "DELETE", Watch("N.CU"))
    assert set(counting.watched("R")) == {"N.CV", "N.CUO"}


def test_a_forced_port_keeps_its_value_until_it_is_released(counting: ManagementClient) -> None:
    counting.watch("R", "F.D")
    counting.demand("R", "WRITE", ManagedConnection("TRUE", "F.D", "true"))
    assert counting.demand("R", "READ", Watch()).watches == {"R": {"F.D": Watched("TRUE", forced=True)}}
    counting.trigger("R", "F.CLK")
    wait_for(counting, "R", "F.Q", lambda value: value == "TRUE")
    counting.demand("R", "WRITE", ManagedConnection("*", "F.D", "false"))
    counting.trigger("R", "F.CLK")
    wait_for(counting, "R", "F.Q", lambda value: value == "FALSE")
    assert counting.demand("R", "READ", Watch()).watches == {"R": {"F.D": Watched("FALSE")}}


def test_blocks_and_connections_come_and_go_while_the_others_keep_their_state(counting: ManagementClient) -> None:
    counting.create_block("R", "X", "E_CTU")
    counting.write("R", "X.PV", "2")
    counting.connect("R", "N.CUO", "X.CU")
    counting.trigger("R", "N.CU")
    wait_for(counting, "R", "M.CV", lambda value: value == "2")
    assert counting.read("R", "X.CV") == "0"
    assert counting.read("R", "X.PV") == "2"
    counting.demand("R", "START", ManagedBlock("X", "E_CTU"))
    counting.trigger("R", "N.CU")
    wait_for(counting, "R", "X.CV", lambda value: value == "1")
    assert [counting.read("R", name) for name in ("N.CV", "M.CV")] == ["3", "3"]
    assert counting.request("R", "DELETE", ManagedBlock("X", "")).reason == "INVALID_STATE"
    counting.demand("R", "STOP", ManagedBlock("X", "E_CTU"))
    counting.trigger("R", "N.CU")
    wait_for(counting, "R", "M.CV", lambda value: value == "4")
    assert counting.read("R", "X.CV") == "1"
    counting.demand("R", "DELETE", ManagedConnection("N.CUO", "X.CU"))
    counting.delete_block("R", "X")
    assert counting.request("R", "READ", ManagedConnection("X.CV", "*")).reason == "NO_SUCH_OBJECT"
    counting.trigger("R", "N.CU")
    wait_for(counting, "R", "M.CV", lambda value: value == "5")


def test_a_data_connection_takes_another_source(counting: ManagementClient) -> None:
    counting.create_block("R", "P", "E_CTU")
    counting.demand("R", "START", ManagedBlock("P", "E_CTU"))
    counting.demand("R", "DELETE", ManagedConnection("N.Q", "F.D"))
    counting.connect("R", "P.Q", "F.D")
    counting.trigger("R", "P.CU")
    wait_for(counting, "R", "P.Q", lambda value: value == "TRUE")
    counting.trigger("R", "F.CLK")
    wait_for(counting, "R", "F.Q", lambda value: value == "TRUE")


def test_a_block_is_reset_alone(counting: ManagementClient) -> None:
    for action in ("KILL", "RESET", "START"):
        counting.demand("R", action, ManagedBlock("N", "E_CTU"))
    assert counting.read("R", "M.CV") == "1"
    counting.trigger("R", "N.CU")
    wait_for(counting, "R", "M.CV", lambda value: value == "2")


def test_an_ampersand_needs_no_escape(served: ServedDevice) -> None:
    text = '<Request ID="1" Action="WRITE"><Connection Source="a & b &amp; c" Destination="C.ID" /></Request>'
    with served.client() as client:
        build(client, "R", "C CLIENT_0 QI=1")
        assert served.device.execute("R", parse_request(text)).reason is None
        assert client.read("R", "C.ID") == "a & b & c"


def test_types_are_listed_and_described(served: ServedDevice, tmp_path: Path) -> None:
    (tmp_path / "ADAPTER.adp").write_text("<AdapterType Name='ADAPTER'/>")
    with served.client() as client:
        assert client.demand("", "QUERY", ManagedType("*", tag="AdapterType")).names == ("ADAPTER",)
        assert "LREAL" in (client.demand("", "QUERY", ManagedType("*", tag="DataType")).names or ())
    described = served.device.execute("", Request("1", "QUERY", ManagedType("DOUBLER"))).xml()
    assert '<FBType Comment="generated" Name="DOUBLER"><InterfaceList>' in described
    assert '<Event Name="REQ"><With Var="X"/></Event>' in described
    assert '<VarDeclaration Name="Y" Type="LREAL"/>' in described


def test_a_change_that_cannot_be_leaves_what_runs(served: ServedDevice, caplog: pytest.LogCaptureFixture) -> None:
    with served.client() as client:
        build(client, "R", DOUBLING)
        client.start("R")
        for name, kind in (("A", "F_ADD"), ("B", "DOUBLER"), ("C", "E_CTU")):
            client.create_block("R", name, kind)
        client.connect("R", "B.Y", "A.IN1")
        client.connect("R", "S.QO", "A.IN2")  # no number is both a truth value and a real
        with served.connect("S") as peer:
            assert peer.exchange([1.0]) == (2.0,)
        assert "resource R keeps the network that it had: " in caplog.text
        client.demand("R", "DELETE", ManagedConnection("S.QO", "A.IN2"))
        client.demand("R", "START", ManagedBlock("B", "DOUBLER"))
        client.connect("R", "S.IND", "B.REQ")
        client.connect("R", "S.RD_1", "B.X")
        with served.connect("S") as peer:
            assert peer.exchange([3.0]) == (6.0,)
        assert client.read("R", "B.Y") == "6.0"


class Changed(RemoteController):
    """A controller whose network is changed, by 19 requests between two samples each, from one sample on."""

    def __init__(self, address: StreamAddress, shadow: Shadow, client: ManagementClient, resource: str) -> None:
        super().__init__(address, shadow, PATIENCE)
        self.changes = neutral_change(resource)
        self._management = client

    def step(self, sensors: Sensors) -> Voltages:
        if sensors.sequence >= 200:
            made, self.changes = self.changes[:19], self.changes[19:]
            for _ in self._management.demand_all(made):
                pass
        return super().step(sensors)


def test_a_neutral_change_of_the_cell_changes_no_byte_of_its_log(cell: ServedDevice, tmp_path: Path) -> None:
    settings = CellSettings(duration=8.0, seed=2, noise=0.002, control=DEPLOYED)
    shadow = EmbeddedController(settings.control, settings.blocks, sequence_of(settings))
    name = cell.library.load_system(BLOCKS / SYSTEM).devices[0].resources[0].name
    address = cell.device.addresses()[on_device(EMULATOR.block)]
    with cell.client() as client, closing(Changed(address, shadow, client, name)) as controller:
        runs = {"changed": Cell(settings, controller), "plain": Cell(settings)}
        for file, run in runs.items():
            run.run()
            run.log.freeze().write_parquet(tmp_path / file)
        assert controller.changes == []
        assert controller.largest_difference == 0.0
        assert client.read(name, "EXTRA0.CV") != "0"
        assert client.read(name, "EXTRA37.PV") == "7"
    assert (tmp_path / "changed").read_bytes() == (tmp_path / "plain").read_bytes()
