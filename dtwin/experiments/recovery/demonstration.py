"""A run of the recovery: a cell with all services, a fault of its own making, and the operator who puts it right."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from dtwin.emulation.machine.files import machine_of
from dtwin.experiments.identification.standard import standard_estimate
from dtwin.experiments.recovery.operator import Operator
from dtwin.experiments.recovery.outcome import Recovery, healthy_run, judge
from dtwin.identification.excitation.rig import Rig
from dtwin.identification.model import write_model
from dtwin.identification.result import from_estimate
from dtwin.parameters import PERIOD
from dtwin.run.recording import read_log
from services.launch import CellOptions, launched


def recover(options: CellOptions, progress: Callable[[float], None] = lambda time: None) -> Recovery:
    """Starts a cell with all services, lets a joint's friction grow, and has it put right.

    Args:
        options: what the cell is run with; its seed also gives the joint and how much the friction grows.
        progress: told the plant time, s.

    Raises:
        IdentificationError: the model of the healthy arm cannot be identified.
        CommunicationError: the cell does not come up.
        KeyboardInterrupt: the cell was asked to stop.
    """
    generator = np.random.default_rng(np.random.SeedSequence(options.seed).spawn(3)[2])
    joint, factor = int(generator.integers(1, 4)), round(float(generator.uniform(1.5, 1.9)), 3)
    fault = f"D{joint}*={factor:g}"
    estimate = standard_estimate(Rig(noise=options.noise, machine=machine_of(options.machine)), generator)
    model = from_estimate(estimate, np.ones(3), "simulated experiment")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_model(model, folder / "arm.json")
        log_file = options.log or folder / "run.parquet"
        complete = replace(
            options,
            log=log_file,
            identification=True,
            store=folder / "identified",
            monitoring=True,
            model=folder / "arm.json",
            simulation=True,
            history=folder / "history.jsonl",
        )
        with launched(complete) as cell:
            cell.await_ready()
            story = Operator(cell.bus, model.arm, lambda: cell.over, progress).work(fault)
            if cell.stop.is_set():
                raise KeyboardInterrupt
        log = read_log(log_file)
    settings = replace(complete.settings(), duration=len(log) * PERIOD)
    healthy = healthy_run(settings, model.arm, float("inf") if story.started is None else story.started)
    return judge(options.seed, fault, story, log, healthy)
