"""Speed of the parts on this machine: rounds of all of them in turn, so that a drifting machine hits all alike."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.table import Table

from dtwin.campaign.spread import Workers
from dtwin.commands.frame import JsonOption, at_least
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import EMULATOR, sensor_values
from dtwin.controller.runtime import Runtime, chosen
from dtwin.controller.settings import ControlSettings, usual_gains
from dtwin.emulation import MODEL_FILE
from dtwin.emulation.raw import raw_file_ticks, raw_plant_ticks
from dtwin.errors import ParameterError
from dtwin.monitoring.estimation.belief import Unmodelled, assumed
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.parameters import PERIOD, PICKUP, ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.loop import run, tick_count
from dtwin.run.options import ControlOptions
from dtwin.run.settings import CellSettings
from dtwin.signals import Sensors
from dtwin.simulation.checks import MOTIONS
from dtwin.simulation.objective import Objective, scenarios_for
from dtwin.simulation.optimise import optimise
from dtwin.simulation.whatif import MotionCase, Simulator
from dtwin.terminal import print_json, print_table
from dtwin.twin.closed_loop import exchanges
from dtwin.twin.rollout import rollout
from dtwin.view.write import write_recording
from evidence.bench.blocks import online_change, trace_cost
from evidence.monitoring.twin_cell import TwinCell
from iec61499.native.resource import NativeResource
from iec61499.net.address import LOOPBACK, Address, LocalAddress, StreamAddress
from iec61499.net.client import BlockingClient
from iec61499.net.reactor import Reactor
from iec61499.net.stream import StreamServer
from iec61499.net.wire import MessageReader

DURATION: Final = 120.0
"""s of plant time in one timed run"""
ROLLOUT_SAMPLES: Final = 20_000
SUBSTEPS: Final = 4
CANDIDATES: Final = 120
"""Candidates that one round of the search tries."""
BOXES: Final = (0.19, 0.21)
"""Least and largest mass of a box in the search, kg."""
WHAT_IFS: Final = 20
"""Motions that one round simulates."""
FIRST_MACHINE: Final = 901
"""Number of the drawn machine whose work is watched."""
UNKNOWN_NOISE: Final = 5e-4
UNKNOWN_TORQUE: Final = 5e-2
"""What the monitor believes of its noise, rad, and of torques that no effect explains, N m: standard deviations."""
DAY: Final = 86_400.0
"""s"""
WATCHED: Final = 60.0
"""s of plant time that each core works and watches in one round"""
GETTING_TO_KNOW: Final = 40.0
"""s of plant time until the monitor has listened to the encoders and has seen enough motion"""
MESSAGES: Final = 2000
"""Messages that are written and read, and exchanges over a stream, in one round."""


def benchmark(rounds: int = 5, between: Callable[[str], None] = lambda name: None) -> dict[str, dict[str, float]]:
    """Medians over the rounds, by part, and the rates relative to `raw_mj_step`: MuJoCo alone on models/arm.xml.

    `raw_plant_step` is MuJoCo alone on what the plant compiles of that file: without what is only seen.
    """
    ticks = tick_count(DURATION)
    parts: dict[str, Callable[[], float]] = {
        "raw_mj_step": lambda: _raw(raw_file_ticks(), ticks),
        "raw_plant_step": lambda: _raw(raw_plant_ticks(), ticks),
        "closed_loop": lambda: _closed_loop(ticks),
        "closed_loop_log": lambda: _closed_loop_log(),
        "closed_loop_recording": lambda: _closed_loop_recording(),
        "twin_rollout": _rollout,
        "controller_tick": lambda: _controller("python"),
        "controller_tick_native": lambda: _controller("native"),
        "controller_tick_inside": _controller_inside,
        "wire_message": _wire,
        "tcp_round_trip": lambda: _round_trip(Address(LOOPBACK, 0)),
        "local_round_trip": _local_round_trip,
        "what_if": _what_if,
        "optimise": _optimise,
        "monitored_work": _monitored_work,
        "online_change": online_change,
        "trace": trace_cost,
    }
    if not _has_machine_code():
        for name in ("controller_tick_native", "controller_tick_inside"):
            del parts[name]
    for warm_up in ("closed_loop_recording", "twin_rollout", "what_if"):
        parts[warm_up]()
    seconds: dict[str, list[float]] = {name: [] for name in parts}
    for _ in range(rounds):
        for name, part in parts.items():
            between(name)
            seconds[name].append(part())
    return _figures(seconds, ticks)


def _figures(seconds: Mapping[str, Sequence[float]], ticks: int) -> dict[str, dict[str, float]]:
    """What `benchmark` returns, from what each round of each part took, s; runs were of so many ticks."""
    middle = {name: median(values) for name, values in seconds.items()}
    raw = seconds["raw_mj_step"]
    loops = ("raw_mj_step", "raw_plant_step", "closed_loop", "closed_loop_log", "closed_loop_recording")
    result: dict[str, dict[str, float]] = {
        name: {
            "ticks_per_second": ticks / middle[name],
            "real_time_factor": DURATION / middle[name],
            "relative_to_raw": median(a / b for a, b in zip(raw, seconds[name], strict=True)),
        }
        for name in loops
    }
    result["twin_rollout"] = {"steps_per_second": ROLLOUT_SAMPLES * SUBSTEPS / middle["twin_rollout"]}
    python = seconds["controller_tick"]
    for name in ("controller_tick", "controller_tick_native", "controller_tick_inside"):
        if name in seconds:
            result[name] = {
                "microseconds": 1e6 * middle[name] / ticks,
                "relative_to_python": median(a / b for a, b in zip(python, seconds[name], strict=True)),
            }
    result["closed_loop_log"]["relative_to_raw_plant"] = median(
        a / b for a, b in zip(seconds["raw_plant_step"], seconds["closed_loop_log"], strict=True)
    )
    result["wire_message"] = {"microseconds": 1e6 * middle["wire_message"] / MESSAGES}
    for trip in ("tcp_round_trip", "local_round_trip"):
        result[trip] = {"microseconds": 1e6 * middle[trip] / MESSAGES}
    result["monitored_work"] = {"minutes_a_day": DAY * middle["monitored_work"] / 60.0}
    result["optimise"] = {"motions_per_second": 1.0 / middle["optimise"]}
    for name in ("what_if", "online_change"):
        result[name] = {"milliseconds": 1e3 * middle[name]}
    result["trace"] = {"relative_to_untraced": middle["trace"]}
    return result


def _timed(work: Callable[[], Any]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def _raw(step: Callable[[int], None], ticks: int) -> float:
    return _timed(lambda: step(ticks))


def _closed_loop(ticks: int) -> float:
    cell = Cell(CellSettings(duration=DURATION))
    return _timed(lambda: run(cell.emulation, cell.controller, ticks))


def _closed_loop_log() -> float:
    cell = Cell(CellSettings(duration=DURATION))
    return _timed(cell.run)


def _closed_loop_recording() -> float:
    cell = Cell(CellSettings(duration=DURATION))
    with tempfile.TemporaryDirectory() as folder:

        def work() -> None:
            cell.run()
            write_recording(cell.log.freeze(), MODEL_FILE, Path(folder) / "run.rrd")

        return _timed(work)


def _rollout() -> float:
    time_axis = np.arange(ROLLOUT_SAMPLES) * PERIOD
    volts = np.stack([np.sin(time_axis * (i + 1)) for i in range(3)], axis=1)
    start = np.array([-1.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    return _timed(lambda: rollout(ArmParameters(), start, volts, 0.2, substeps=SUBSTEPS))


def _has_machine_code() -> bool:
    return isinstance(EmbeddedController().resource, NativeResource)


def _samples() -> list[Sensors]:
    """The samples of a real run."""
    cell = Cell(CellSettings(duration=DURATION))
    samples: list[Sensors] = []
    run(cell.emulation, cell.controller, cell.ticks, record=lambda record: samples.append(record.sensors))
    return samples


def _controller(runtime: Runtime) -> float:
    """Answers to the samples of a real run, without the run."""
    samples = _samples()
    with chosen(runtime):
        controller = EmbeddedController(CellSettings().control)

    def work() -> None:
        step = controller.step
        for sample in samples:
            step(sample)

    return _timed(work)


def _controller_inside() -> float:
    """The same from machine code, which loops over the samples without a return to Python."""
    resource = EmbeddedController(CellSettings().control).resource
    assert isinstance(resource, NativeResource)
    requests = resource.server(EMULATOR.block).requests([sensor_values(sample) for sample in _samples()])
    answers = np.empty((len(requests), 5))
    function = resource.function(f"exchange__{EMULATOR.block}")

    def work() -> None:
        if exchanges(function, resource.address, requests, answers) != len(requests):
            raise AssertionError("the controller did not answer every sample")

    return _timed(work)


_SAMPLE: Final = sensor_values(Sensors(0, 0.0, (0.1, 0.2, 0.3), 0.9, True, "green"))
_ANSWER: Final = (1.0, 2.0, 3.0, -3.0, True)


def _wire() -> float:
    """Writes and reads a sample as the block EMULATOR receives it."""
    reader = MessageReader(EMULATOR.receives)

    def work() -> None:
        for _ in range(MESSAGES):
            reader.feed(EMULATOR.receives.encode(_SAMPLE))

    return _timed(work)


def _local_round_trip() -> float:
    """Exchanges over a Unix domain socket, as the bridge does with the embedded controller."""
    with tempfile.TemporaryDirectory() as folder:
        return _round_trip(LocalAddress(Path(folder), EMULATOR.number))


def _round_trip(address: StreamAddress) -> float:
    """Exchanges a sample and a command with a server on this machine that computes nothing."""
    with Reactor() as reactor:
        server = StreamServer(
            reactor, address, EMULATOR.receives, EMULATOR.sends, lambda message: server.send(_ANSWER)
        )
        thread = threading.Thread(target=reactor.run)
        thread.start()
        try:
            with BlockingClient(server.address, EMULATOR.receives, EMULATOR.sends, timeout=10.0) as client:
                return _timed(lambda: [client.exchange(_SAMPLE) for _ in range(MESSAGES)])
        finally:
            reactor.stop()
            thread.join()
            server.close()


def _what_if() -> float:
    """Simulates motions of 4 s with a box on the twin, under the function blocks with other gains each time."""
    simulator = Simulator()
    gains = [usual_gains("computed_torque", kp=(200.0 + k, 500.0, 300.0)) for k in range(WHAT_IFS + 1)]
    settings = [ControlSettings(4.0, each) for each in gains]
    first, *cases = [MotionCase("red", each, PICKUP.theta, payload=0.2, duration=4.0) for each in settings]
    simulator.run(first)
    return median(_timed(partial(simulator.run, case)) for case in cases)


def _optimise() -> float:
    """Time for one motion of candidates that a search tries, on all cores."""
    objective = Objective(ControlSettings(), scenarios_for(MOTIONS, ArmParameters(), BOXES))
    found = optimise(objective, (1.5, 3.0), candidates=CANDIDATES)
    return found.seconds / found.motions


def _monitored_work() -> float:
    """Time for a second of monitored work of the twin with effects, on all cores, s.

    Each core has a cell of its own: plant, controller, and the monitor of an arm with effects on every sample.
    """
    with Workers() as pool:
        return max(pool.map(watch_work, range(pool.count))) / (pool.count * WATCHED)


def watch_work(seed: int) -> float:
    """Lets a machine of the twin, given by the seed of its work, work while a monitor watches.

    Returns:
        the time that WATCHED seconds of work take once the monitor knows the arm, s.

    Raises:
        ParameterError: the monitor does not watch, because the model does not fit or has failed.
    """
    cell = TwinCell(FIRST_MACHINE, seed, ControlOptions().control())
    belief = assumed(cell.arm, (UNKNOWN_NOISE,) * 3)
    monitor = Monitor(replace(belief, effects=cell.effects, error=Unmodelled(slow=(UNKNOWN_TORQUE,) * 3)))

    def work(seconds: float) -> None:
        seen = stream(cell.run(seconds))
        seen.feed(monitor, 0, len(seen))

    work(GETTING_TO_KNOW)
    elapsed = _timed(partial(work, WATCHED))
    if monitor.events:
        raise ParameterError(f"monitored work: expected nothing to be noticed, got {monitor.events[0].text!r}")
    return elapsed


@dataclass(frozen=True)
class Bench(JsonOption):
    """Measure raw MuJoCo steps, the closed loop, the twin's rollout and the controller; medians of several rounds."""

    rounds: int = 5
    """Number of times that each part is measured; the parts take turns."""

    def execute(self) -> int:
        at_least("--rounds", self.rounds, 1)
        with Console(stderr=True).status("measuring") as status:
            result = benchmark(self.rounds, lambda name: status.update(f"measuring {name}"))
        if self.json:
            print_json(result)
            return 0
        table = Table("part", "measure", "median", title=f"medians of {self.rounds} rounds")
        for part, measures in result.items():
            for k, (name, value) in enumerate(measures.items()):
                table.add_row(
                    part if k == 0 else "",
                    name.replace("_", " "),
                    f"{value:,.3g}" if value < 100 else f"{value:,.0f}",
                )
        print_table(table)
        return 0
