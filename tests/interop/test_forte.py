"""The application on a real 4diac FORTE, deployed by this project, against the embedded runtime.

The same tests hold the embedded runtime as a device to it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dtwin.cli import main
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.remote import RemoteController
from dtwin.controller.settings import USUAL_GAINS, Compensation, ControlSettings
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.faults import parse_fault
from dtwin.logs.log import Log
from dtwin.parameters import ArmParameters, every_joint
from dtwin.run.cell import Cell
from dtwin.run.loop import run
from dtwin.run.settings import CellSettings
from dtwin.signals import STOPS
from iec61499 import model
from iec61499.deploy.build import deploy
from iec61499.deploy.plan import plan_deployment
from iec61499.library import Library
from iec61499.literals import parse_literal
from iec61499.management.bootfile import print_boot_file
from iec61499.management.client import ManagementClient
from iec61499.net.client import BlockingClient
from iec61499.net.wire import Signature
from iec61499.runtime.resource import Resource
from iec61499.standard.notation import basic
from iec61499.types import BOOL, DINT, LREAL
from tests.outside import readings
from tests.outside.around import Around
from tests.outside.effect import together
from tests.support.devices import BLOCKS, DeployedApplication, Receiver, embedded
from tests.support.forte import FORTE, FORTES, NO_FORTE, forte
from tests.support.waiting import connected, until

SAME = 1e-9
"""The largest difference (V) between FORTE and the embedded runtime."""
needs_forte = pytest.mark.skipif(not FORTE, reason=NO_FORTE)


@pytest.fixture(params=["embedded", *FORTES])
def served(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[DeployedApplication]:
    with embedded() if request.param == "embedded" else forte(tmp_path, binary=request.param) as management:
        device = DeployedApplication(management)
        device.deploy()
        with device.client:
            yield device


def controller(served: DeployedApplication, settings: ControlSettings | None = None) -> RemoteController:
    """A controller for the device's application, with a new embedded one as its shadow."""
    shadow = EmbeddedController(settings)
    return connected(lambda: RemoteController(served.address(61500), shadow, timeout=10.0))


def assert_same_run(one: Log, other: Log) -> None:
    assert one.events == other.events
    assert np.abs(one.stack("volts") - other.stack("volts")).max() <= SAME


def test_a_minute_of_pick_and_place_is_the_same(served: DeployedApplication) -> None:
    settings = CellSettings(duration=60.0, seed=1, noise=0.001)
    alone = Cell(settings)
    alone.run()
    with controller(served) as remote:
        cell = Cell(settings, remote)
        cell.run()
    log = cell.log.freeze()
    assert_same_run(log, alone.log.freeze())
    assert cell.summary(log).boxes.delivered > 1


def test_a_minute_under_the_cascade_is_the_same(served: DeployedApplication) -> None:
    control = ControlSettings(gains=USUAL_GAINS["cascade"], law="cascade")
    served.deploy(settings=control)
    settings = CellSettings(duration=60.0, seed=2, noise=0.001, control=control)
    alone = Cell(settings)
    alone.run()
    with controller(served, control) as remote:
        cell = Cell(settings, remote)
        cell.run()
    log = cell.log.freeze()
    assert_same_run(log, alone.log.freeze())
    assert cell.summary(log).boxes.delivered > 1


LIES = together(readings.burst(start=1.0, every=2.0), readings.freeze(start=4.3, every=1e6, length=1e6, joints=(2,)))


@pytest.mark.parametrize("pull", [1.0, 0.4], ids=["unknown", "known"])
def test_readings_that_are_not_believed_are_the_same(served: DeployedApplication, pull: float) -> None:
    """Bursts that are waited for, then an encoder that stops in mid-motion and the stop that follows."""
    control = ControlSettings(law="cascade", compensation=Compensation(pull=every_joint(pull)))
    served.deploy(settings=control)
    with controller(served, control) as remote:
        run(Around(Emulation(noise=0.001, seed=4), LIES, seed=4), remote, 700)
        assert remote.largest_difference <= SAME
    assert int(served.client.read("EMB_RES", "CELL.TWIN.MONITORING.DECISION.STOP")) == 2
    assert int(served.client.read("EMB_RES", "CELL.OBSERVER.SIGHT2")) == -1
    assert float(served.client.read("EMB_RES", "CELL.OBSERVER.DOUBT")) > 12.0


def test_a_run_is_the_same_to_the_byte(served: DeployedApplication) -> None:
    settings = CellSettings(duration=40.0, seed=3, noise=0.001)
    alone = Cell(settings)
    alone.run()
    with controller(served) as remote:
        cell = Cell(settings, remote)
        cell.run()
    found, expected = cell.log.freeze(), alone.log.freeze()
    assert found.events == expected.events
    assert {name: values.tobytes() for name, values in found.columns.items()} == {
        name: values.tobytes() for name, values in expected.columns.items()
    }
    assert cell.summary(found).boxes.delivered > 0


def test_a_second_run_on_the_same_application(served: DeployedApplication) -> None:
    for seed, duration in ((1, 15.0), (2, 24.7), (3, 5.0)):
        settings = CellSettings(duration=duration, seed=seed)
        alone = Cell(settings)
        alone.run()
        with controller(served) as remote:
            cell = Cell(settings, remote)
            cell.run()
        assert_same_run(cell.log.freeze(), alone.log.freeze())


def test_a_second_deployment_takes_the_place_of_the_first(served: DeployedApplication) -> None:
    settings = CellSettings(duration=3.0, seed=1)
    served.deploy()
    with controller(served) as remote:
        Cell(settings, remote).run()
        served.client.write("EMB_RES", "CELL.PLANNER.T", "9.0")
        # the client of the first one is still there
        served.deploy()
    with controller(served) as remote:
        Cell(settings, remote).run()
        assert remote.largest_difference <= SAME
    assert float(served.client.read("EMB_RES", "CELL.PLANNER.T")) == 2.0


@needs_forte
def test_changed_code_takes_the_place_of_the_old_one(tmp_path: Path) -> None:
    blocks = tmp_path / "fb"
    blocks.mkdir()
    for file in BLOCKS.glob("*.fbt"):
        (blocks / file.name).write_text(file.read_text().replace("V_GRIPPER := 3.0", "V_GRIPPER := 2.5"))
    with forte(tmp_path) as management:
        device = DeployedApplication(management)
        for folder, volts in ((BLOCKS, 3.0), (blocks, 2.5), (BLOCKS, 3.0)):
            device.deploy(folder)
            with controller(device) as remote:
                cell = Cell(CellSettings(duration=0.1), remote)
                cell.run()
            assert cell.log.freeze().columns["volts_4"][-1] == volts


def test_identification_gains_and_model_from_the_twin(served: DeployedApplication) -> None:
    """What comes to the twin's ports between two samples has the same effect; what they send is the same."""
    response: list[tuple[object, ...]] = []
    monitoring: list[tuple[object, ...]] = []

    def listen(application: Resource) -> None:
        application.port("TWIN.IDENTIFICATION.BLOCK.DATA").attach(response.append)
        application.port("TWIN.MONITORING.DATA").attach(monitoring.append)

    shadow = EmbeddedController(prepare=listen)
    remote = connected(lambda: RemoteController(served.address(61500), shadow, timeout=10.0))
    listeners = (
        Receiver(served.address(61502), Signature([LREAL] * 7)),
        Receiver(served.address(61503), Signature([LREAL] * 6 + [BOOL, LREAL])),
    )
    generator = np.random.default_rng(1)
    cell = Cell(CellSettings(duration=60.0, seed=4, noise=0.001), remote)

    def advance(ticks: int) -> None:
        run(cell.emulation, remote, ticks, record=cell.log.append)
        assert remote.largest_difference <= SAME

    def tell(port: int, block: str, *values: float | bool) -> None:
        kind = BOOL if isinstance(values[0], bool) else LREAL
        served.tell(port, Signature([kind] * len(values)), values)
        shadow.resource.port(f"TWIN.{block}").deliver(values)
        shadow.resource.run_until_idle()

    advance(300)
    tell(61501, "IDENTIFICATION.REQUEST", True)
    advance(1)
    assert served.client.read("EMB_RES", "CELL.SELECTOR.OVERRIDE") == "TRUE"
    advance(400)
    assert served.client.read("EMB_RES", "CELL.SELECTOR.OVERRIDE") == "FALSE"
    tell(61504, "SIMULATION.GAIN_PORT", *generator.uniform(10.0, 300.0, 6), *generator.uniform(1.0, 3.0, 3), 1.5)
    advance(700)
    tell(61505, "SIMULATION.MODEL_PORT", *(ArmParameters().vector() * generator.uniform(0.9, 1.1, 21)))
    advance(1500)
    tell(61501, "IDENTIFICATION.REQUEST", True)
    advance(100)
    tell(61501, "IDENTIFICATION.REQUEST", False)
    advance(200)
    for listener, expected in zip(listeners, (response, monitoring), strict=True):
        assert listener.received(len(expected)) == expected
        listener.close()
    assert len(response) == 450
    assert len(monitoring) > 200
    # the voltages of the controller after the signal follow on without a jump
    back = cell.log.freeze().stack("volts")[651:800, :3]
    assert np.abs(np.diff(back, axis=0)).max() < 0.5
    remote.close()


def test_stop_hold_torque_off_and_release(served: DeployedApplication) -> None:
    """A verdict stops the arm in the same way; one that has lost its torque falls without voltage, until released."""
    shadow = EmbeddedController()
    verdicts = shadow.resource.server("TWIN.MONITORING.VERDICT")
    remote = connected(lambda: RemoteController(served.address(61500), shadow, timeout=10.0))
    twin = connected(
        lambda: BlockingClient(served.address(61506), Signature([DINT, LREAL, BOOL]), Signature([DINT]), 10.0)
    )
    faults = (parse_fault("K2*=0.1@19.9-30"),)
    cell = Cell(CellSettings(duration=60.0, seed=4, noise=0.001, faults=faults), remote)

    def advance(ticks: int) -> None:
        run(cell.emulation, remote, ticks, record=cell.log.append)
        assert remote.largest_difference <= SAME

    def tell(state: int, confidence: float, release: bool) -> str:
        values = (state, confidence, release)
        (stop,) = twin.exchange(values)
        assert verdicts.exchange(values) == (stop,)
        assert shadow.resource.read("TWIN.STOP") == stop
        return STOPS[int(stop)]

    advance(1100)
    assert tell(2, 0.9, False) == "none"
    assert tell(2, 1.0, False) == "braking"
    advance(20)
    assert tell(0, 0.0, True) == "braking"
    advance(280)
    assert tell(0, 1.0, False) == "standstill"
    assert tell(0, 0.0, True) == "none"
    advance(500)
    served.tell(61501, Signature([BOOL]), [True])
    shadow.resource.port("TWIN.IDENTIFICATION.REQUEST").deliver((True,))
    shadow.resource.run_until_idle()
    advance(95)
    assert tell(2, 1.0, False) == "braking"
    advance(1)
    assert served.client.read("EMB_RES", "CELL.SELECTOR.OVERRIDE") == "FALSE"
    advance(800)
    assert tell(0, 1.0, False) == "torque off"
    assert not cell.log.freeze().stack("volts")[-400:, :3].any()
    advance(700)
    assert tell(0, 0.0, True) == "none"
    advance(1000)
    assert tell(3, 1.0, False) == "torque off"
    advance(100)
    assert not cell.log.freeze().stack("volts")[-100:, :3].any()
    # another arm on the same application: still without torque
    other = Cell(CellSettings(duration=3.0, seed=5), remote)
    other.run()
    assert remote.largest_difference <= SAME
    assert not other.log.freeze().stack("volts")[:, :3].any()
    assert tell(0, 1.0, False) == "torque off"
    twin.close()
    remote.close()


LITERALS = {
    "BOOL": "TRUE",
    "SINT": "-128",
    "INT": "-32768",
    "DINT": "-2147483648",
    "LINT": "-9223372036854775808",
    "USINT": "255",
    "UINT": "65535",
    "UDINT": "4294967295",
    "ULINT": "18446744073709551615",
    "BYTE": "16#FF",
    "WORD": "16#FFFF",
    "DWORD": "16#FFFFFFFF",
    "LWORD": "16#FFFFFFFFFFFFFFFF",
    "REAL": "1.5",
    "LREAL": "0.1",
    "STRING": "'a$'b'",
    "WSTRING": '"w"',
    "TIME": "T#1h2m3s4ms",
}
WRAPPING = ("SINT", "INT", "DINT", "USINT", "UINT", "UDINT")


@needs_forte
def test_every_type_reaches_forte_and_wraps_there(tmp_path: Path) -> None:
    inputs = "; ".join(f"X_{name}: {name}" for name in LITERALS) + "; X: LREAL[3]"
    outputs = "; ".join(f"Y_{name}: {name}" for name in LITERALS) + "; Y: LREAL[3]"
    sums = "; ".join(f"Z_{name}: {name}" for name in WRAPPING)
    copies = "".join(f"Y_{name} := X_{name};\n" for name in LITERALS)
    library = Library()
    doubling = "".join(f"Z_{name} := X_{name} + X_{name};\n" for name in WRAPPING)
    rows = [("REQ", copies, "CNF"), ("SUM", doubling, ""), ("LIST", "Y := X; Y[1] := 2.0 * X[1];", "")]
    library.add(basic("COPY", "", "REQ, SUM, LIST -> CNF", f"{inputs} -> {outputs}; {sums}", rows))
    parameters = tuple(model.Parameter(f"X_{name}", literal) for name, literal in LITERALS.items())
    blocks = (
        model.Block("START", "E_RESTART"),
        model.Block("C", "COPY", (*parameters, model.Parameter("X", "[1.0, 2.5, -3.0]"))),
    )
    events = tuple(model.Connection("START.COLD", f"C.{event}") for event in ("REQ", "SUM", "LIST"))
    network = model.FBNetwork(blocks, (), events)
    alone = Resource(network, library)
    alone.start()
    names = [*(f"Y_{name}" for name in LITERALS), *(f"Z_{name}" for name in WRAPPING)]
    with forte(tmp_path) as management, connected(lambda: ManagementClient(management)) as client:
        deploy(client, plan_deployment("R", network, library))
        # the blocks run after the deployment has been acknowledged; LIST is their last event
        until(lambda: client.read("R", "C.Y").replace(" ", "") == "[1,5,-3]", "all events have been dealt with")
        for name in names:
            expected, kind = alone.read(f"C.{name}"), alone.variable_type(f"C.{name}")
            text = client.read("R", f"C.{name}")
            assert (text if isinstance(expected, str) else parse_literal(text, kind)) == expected
        assert alone.read("C.Y") == [1.0, 5.0, -3.0]


@pytest.mark.parametrize("binary", FORTES)
def test_forte_boots_from_an_exported_file(tmp_path: Path, binary: str) -> None:
    boot = tmp_path / "cell.fboot"
    with forte(tmp_path, binary=binary) as management:
        ports = DeployedApplication(management)
        boot.write_text(print_boot_file(ports.plan().commands))
    with forte(tmp_path, "-f", str(boot), binary=binary), controller(ports) as remote:
        Cell(CellSettings(duration=3.0, seed=1), remote).run()
        assert remote.largest_difference <= SAME


def test_watch_and_stop_from_the_command_line(
    served: DeployedApplication, capsys: pytest.CaptureFixture[str]
) -> None:
    served.client.close()

    def output(*arguments: str) -> list[str]:
        # FORTE refuses a management client until it has noticed that the one before has gone
        while main(["fb", *arguments]):
            assert "connection lost" in capsys.readouterr().err
        return capsys.readouterr().out.splitlines()

    management = str(served.client.address)
    names, *rows = output(
        "watch", management, "CELL.PLANNER.T", "CELL.CONTROLLER.KP2", "--count", "2", "--interval", "0.001"
    )
    assert names == "CELL.PLANNER.T\tCELL.CONTROLLER.KP2"
    assert [list(map(float, row.split("\t"))) for row in rows] == [[2.0, 500.0]] * 2
    assert output("stop", management) == ["EMB_RES stopped"]
