"""`dtwin identify`."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from dtwin.controller.excitation import ExcitationController
from dtwin.emulation.machine.files import machine_of
from dtwin.errors import IdentificationError, ParameterError
from dtwin.files import ensure_writable
from dtwin.identification.data import Experiment, Start, from_log
from dtwin.identification.estimation.estimate import NINETY_FIVE, Estimate, EstimationSettings, identify, load_kernels
from dtwin.identification.estimation.friction import FRICTIONS, Friction, choose, with_friction
from dtwin.identification.excitation.design import optimise
from dtwin.identification.excitation.plan import HELD_OUT, PLAIN, Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.identification.held_out import Comparison, compare
from dtwin.identification.parsing import settings_for
from dtwin.identification.result import from_estimate
from dtwin.identification.store import STORE, ModelStore, check_name
from dtwin.parameters import PERIOD, ArmParameters, assignment, load_arm, unit_of
from dtwin.run.options import MachineOption
from dtwin.run.recording import Log, read_log
from dtwin.terminal import as_text, print_json, print_table

_HELD_OUT_SHARE = 0.2
"""share of a log that is kept for judging the model"""
_MOST_SEGMENTS = 60
"""number of segments of one second that a fit takes from a log; each has six unknowns, and more would take minutes"""
_DESIGN_NOISE = 0.003


@dataclass(frozen=True)
class Identify(MachineOption):
    """Identify the arm's parameters, from a log of the cell or from a simulated 3-2-1-1 experiment.

    The exit status is 1 when the model is in doubt: the search did not converge or ended on a bound, or the residuals
    show that the model is wrong. Such a model is not kept without --anyway.
    """

    log: Annotated[Path | None, tyro.conf.Positional] = None
    """Parquet log of `dtwin run`; without it an experiment is simulated."""
    noise: float = 0.005
    """Encoder noise of the simulated experiment, rad: amplitude (uniform) or standard deviation (gaussian)."""
    noise_kind: Literal["uniform", "gaussian"] = "uniform"
    """uniform adds noise * u with u in [0, 1), so it is biased by half of it; gaussian is not biased."""
    payload: list[float] = field(default_factory=list)
    """Known load at the tip, kg, 0.2 if not given; repeat it for several runs. With a log, the mass of every box;
    without it motions with a box are left out."""
    payload_model: Literal["weight", "point"] = "weight"
    """weight is a load whose inertia does not act on the arm; point is a box in the gripper."""
    free: str = "K,I,c,D"
    """What to estimate: symbols (K, m, I, l, c, D, mu) of all joints, names such as m2, or "all", without mu."""
    friction: Literal["viscous", "coulomb", "both", "auto"] | None = None
    """Friction law to estimate, in place of D and mu of --free; auto takes the law with the least criterion (BIC)."""
    prior: list[str] = field(default_factory=list)
    """Knowledge of a free parameter from elsewhere, NAME=MEAN+-DEVIATION, such as m2=0.116+-0.001."""
    loss: Literal["adaptive", "gaussian", "huber"] = "adaptive"
    """Likelihood: adapted to the noise's shape, least squares, or robust to outliers."""
    optimise: bool = False
    """Design the simulated experiment's signal first."""
    start: Literal["known", "free"] = "known"
    """Whether the simulated experiment's initial state is known or estimated as well."""
    set: list[str] = field(default_factory=list)
    """A parameter of the simulated arm, NAME=NUMBER."""
    known: Path | None = None
    """JSON file with the parameters that are not estimated, by name; the arm's data sheet if not given."""
    seed: int = 0
    """Number of the random generators of noise, further starting points and the design of the signal."""
    save: str | None = "arm"
    """Name to keep the model under; None keeps it nowhere."""
    anyway: bool = False
    """Keep the model even if it is in doubt; it says so."""
    store: Path = STORE
    """Folder of the kept models."""
    plot: Path | None = None
    """Draw motion, intervals and correlation to this PNG file."""
    record: Path | None = None
    """Write motion, intervals and correlation to this .rrd file for the Rerun viewer."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        if self.seed < 0:
            raise ParameterError(f"--seed: expected a whole number of at least 0, got {self.seed}")
        if self.save is not None:
            check_name(self.save)
        for path in (self.plot, self.record):
            if path is not None:
                ensure_writable(path)
        settings = self._settings()
        with Console(stderr=True).status("measuring") as status:
            if self.log is not None:
                training, judging, truth = self._from_log(self.log)
            else:
                training, judging, truth = self._simulated(settings)
            load_kernels()
            status.update("estimating")
            began = time.perf_counter()
            estimate, criteria = self._estimate(training, settings)
            seconds = time.perf_counter() - began
        offset = estimate.problem.offset(estimate.x)
        new = compare(judging, estimate.parameters, offset)
        model = from_estimate(estimate, new.fit, str(self.log or "simulated experiment"))
        doubts = model.validity.doubts
        kept = self.save is not None and (self.anyway or not doubts)
        file = ModelStore(self.store).save(model, self.save).path if self.save and kept else None
        if self.plot is not None or self.record is not None:
            self._draw(estimate, compare(judging, estimate.problem.fixed, offset), new, truth)
        report = _report(estimate, new, truth, criteria, seconds, file, doubts)
        if self.json:
            print_json(report)
        else:
            _print(report, estimate, "" if kept or self.save is None else self.save)
        return 1 if doubts else 0

    def _settings(self) -> EstimationSettings:
        known = load_arm(self.known) if self.known is not None else None
        return settings_for(self.free, known, self.prior, self.loss, self.seed)

    def _estimate(
        self, experiments: tuple[Experiment, ...], settings: EstimationSettings
    ) -> tuple[Estimate, dict[Friction, float] | None]:
        if self.friction is None:
            return identify(experiments, settings), None
        if self.friction != "auto":
            return identify(experiments, with_friction(settings, self.friction)), None
        choice = choose(experiments, settings)
        return choice.estimates[choice.best], {name: choice.estimates[name].bic for name in FRICTIONS}

    def _simulated(
        self, settings: EstimationSettings
    ) -> tuple[tuple[Experiment, ...], tuple[Experiment, ...], ArmParameters | None]:
        nominal = ArmParameters().with_values(dict(map(assignment, self.set)))
        rig = Rig(nominal, self.noise, self.noise_kind, machine=machine_of(self.machine))
        start = Start(known=self.start == "known")
        signal = PLAIN
        generators = [np.random.default_rng(s) for s in np.random.SeedSequence(self.seed).spawn(3)]
        if self.optimise:
            plan = Plan(PLAIN, self._loads()[0], self.payload_model, start)
            signal = optimise(plan, settings.free, settings.known, _DESIGN_NOISE, generators[2]).signal
        plans = [Plan(signal, load, self.payload_model, start) for load in self._loads()]
        blocks = ExcitationController()
        training = tuple(rig.measure(plan, blocks, generators[0]) for plan in plans)
        held_out = Plan(HELD_OUT, plans[0].payload, self.payload_model)
        judging = rig.measure(held_out, blocks, generators[1])
        return training, (judging,), rig.made

    def _from_log(self, path: Path) -> tuple[tuple[Experiment, ...], tuple[Experiment, ...], ArmParameters | None]:
        log = read_log(path)
        if len(self.payload) > 1:
            raise ParameterError(f"--payload: expected one mass of a box for a log, got {len(self.payload)}")
        segments = from_log(log, self.payload[0] if self.payload else None)
        kept = max(1, round(_HELD_OUT_SHARE * len(segments)))
        if len(segments) <= kept:
            raise IdentificationError(f"{path}: too few samples: {len(log)}, expected at least two seconds")
        stride = -(-(len(segments) - kept) // _MOST_SEGMENTS)
        return segments[:-kept:stride], segments[-min(kept, _MOST_SEGMENTS) :], _truth(log)

    def _loads(self) -> list[float]:
        return self.payload or [0.2]

    def _draw(self, estimate: Estimate, old: Comparison, new: Comparison, truth: ArmParameters | None) -> None:
        if self.plot is not None:
            from dtwin.identification.plots import draw

            draw(estimate, old, new, truth, self.plot, f"identified from {self.log or 'a simulated experiment'}")
        if self.record is not None:
            from dtwin.view.identification import write_identification

            rows = [
                (name, estimate.values[name], NINETY_FIVE * estimate.standard_errors[name])
                for name in estimate.identifiability.identifiable
            ]
            motions = {"measured": new.measured, "before": old.predicted, "identified": new.predicted}
            names = estimate.problem.shared
            write_identification(self.record, PERIOD, motions, rows, names, estimate.correlation)


def _truth(log: Log) -> ArmParameters | None:
    """The arm an emulated run was made with, if its log says so."""
    try:
        return msgspec.convert(log.metadata["arm"], ArmParameters)
    except (KeyError, msgspec.ValidationError):
        return None


def _report(
    estimate: Estimate,
    new: Comparison,
    truth: ArmParameters | None,
    criteria: dict[Friction, float] | None,
    seconds: float,
    file: Path | None,
    doubts: str,
) -> dict[str, Any]:
    identifiability = estimate.identifiability
    report = {
        "converged": estimate.converged,
        "rank": identifiability.rank,
        "free": list(identifiability.free),
        "unidentifiable": list(identifiability.unidentifiable),
        "identifiability": identifiability.text(),
        "parameters": {
            name: {
                "estimate": estimate.values[name],
                "standard_error": estimate.standard_errors[name],
                "truth": truth.get(name) if truth else None,
            }
            for name in identifiability.identifiable
        },
        "offsets": estimate.problem.offset(estimate.x).tolist(),
        "noise": estimate.noise.tolist(),
        "noise_shape": estimate.shape,
        "fit": new.fit.tolist(),
        "residual_white": estimate.whiteness.white,
        "bic": estimate.bic,
        "starts": estimate.starts,
        "seconds": seconds,
        "model_file": str(file) if file else None,
    }
    return report | ({"criterion": criteria} if criteria else {}) | ({"doubts": doubts} if doubts else {})


def _share(half: float, value: float) -> str:
    """Half of an interval relative to the value in words; one that is wider than the value says little of it."""
    if not value:
        return ""
    share = abs(half / value)
    return f"{100 * share:.2f} %" if share < 1.0 else "over 100 %"


def _print(report: dict[str, Any], estimate: Estimate, withheld: str) -> None:
    """Prints the report for people; `withheld` is the name under which the model was not kept, "" if none."""
    table = Table("", "estimate", "95 % interval", "unit", "relative", "truth", "error")
    for name, entry in report["parameters"].items():
        value, half, truth = entry["estimate"], NINETY_FIVE * entry["standard_error"], entry["truth"]
        error = f"{100 * (value / truth - 1):+.2f} %" if truth else ""
        table.add_row(
            name,
            f"{value:.6g}",
            f"+- {half:.2g}",
            unit_of(name),
            _share(half, value),
            f"{truth:.6g}" if truth is not None else "",
            error,
        )
    console = Console()
    if table.row_count:
        print_table(table)
    console.print(as_text(report["identifiability"]))
    fits = ", ".join(f"{value:.4f}" for value in report["fit"])
    console.print(
        f"fit on held-out motion {fits}; noise {', '.join(f'{value:.2g}' for value in estimate.noise)} rad",
        highlight=False,
    )
    if "doubts" in report:
        console.print(f"[bold red]Do not use this model: {report['doubts']}.[/]", soft_wrap=True)
    else:
        console.print("The residuals are white: nothing but noise is left to explain.")
    if "criterion" in report:
        criteria = ", ".join(f"{name} {value:.0f}" for name, value in report["criterion"].items())
        console.print(f"criterion (BIC, least is best): {criteria}", highlight=False)
    if report["model_file"]:
        console.print(as_text(f"kept as {report['model_file']}: see dtwin model list"))
    if withheld:
        console.print(as_text(f"not kept as {withheld}: --anyway keeps it all the same"))
    sys.stdout.flush()
