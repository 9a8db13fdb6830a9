"""`dtwin identify`."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console
from rich.table import Table

from dtwin.api.experiment import identify_experiment
from dtwin.api.identification import Identified, identify
from dtwin.commands.frame import arguments_as_options
from dtwin.errors import ModelError, ParameterError
from dtwin.files import PICTURE, RECORDING, ensure_writable
from dtwin.identification.estimation.estimate import NINETY_FIVE, Estimate
from dtwin.identification.store import STORE, ModelStore
from dtwin.names import check_name
from dtwin.parameters import PERIOD, unit_of
from dtwin.pictures import save as save_figure
from dtwin.run.options import MachineOption
from dtwin.terminal import as_text, print_json, print_table


@dataclass(frozen=True)
class Identify(MachineOption):
    """Identify the arm's parameters, from a log of the cell or from a simulated 3-2-1-1 experiment.

    With --arm it identifies any other serial arm from logs of other programs (docs/real-logs.md).

    The exit status is 1 when the model is in doubt: the search did not converge or ended on a bound, or the residuals
    show that the model is wrong. Such a model is not kept without --anyway.
    """

    log: Annotated[Path | None, tyro.conf.Positional] = None
    """Parquet log of `dtwin run`; without it an experiment is simulated."""
    noise: float = 0.005
    """Encoder noise of the simulated experiment, rad: amplitude (uniform) or standard deviation (gaussian)."""
    noise_kind: Literal["uniform", "gaussian"] = "uniform"
    """uniform adds noise * u with u in [0, 1), so it is biased by half of it; gaussian is not biased."""
    payload: tuple[float, ...] = ()
    """Known load at the tip, kg, 0.2 if not given; repeat it for several runs. With a log, the mass of every box;
    without it motions with a box are left out."""
    payload_model: Literal["weight", "point"] = "weight"
    """weight is a load whose inertia does not act on the arm; point is a box in the gripper."""
    free: str = "K,I,c,D"
    """What to estimate: symbols (K, m, I, l, c, D, mu) of all joints, names such as m2, or "all", without mu."""
    friction: Literal["viscous", "coulomb", "both", "auto"] | None = None
    """Friction law to estimate, in place of D and mu of --free; auto takes the law with the least criterion (BIC)."""
    prior: tuple[str, ...] = ()
    """Knowledge of a free parameter from elsewhere, NAME=MEAN+-DEVIATION, such as m2=0.116+-0.001."""
    loss: Literal["adaptive", "gaussian", "huber"] = "adaptive"
    """Likelihood: adapted to the noise's shape, least squares, or robust to outliers."""
    optimise: bool = False
    """Design the simulated experiment's signal first."""
    start: Literal["known", "free"] = "known"
    """Whether the simulated experiment's initial state is known or estimated as well."""
    set: tuple[str, ...] = ()
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
    arm: str | None = None
    """Another arm, a serial chain of any number of joints: a name of arms/, its file (*.toml), or a model (*.urdf,
    *.xml). It is identified from the logs alone."""
    tip: str | None = None
    """Last link of the chain (--arm); the end of the longest chain if not given."""
    also: tuple[Path, ...] = ()
    """A further log of the same arm (--arm); repeat it."""
    columns: Path | None = None
    """TOML file that says what the columns of the logs mean (--arm); guessed if not given, see dtwin log show."""
    load: tuple[str, ...] = ()
    """What was held in a log (--arm): FILE=KG where it was weighed, FILE=? where it is to be found."""
    out: Path | None = None
    """TOML file for all numbers with intervals (--arm)."""
    urdf: Path | None = None
    """URDF file for the arm with the bodies and the friction that were found (--arm)."""
    mjcf: Path | None = None
    """MJCF file for the same, with the inertia of rotors (--arm); of a URDF it is the chain without shapes."""
    arm_out: Path | None = None
    """TOML file for the arm as all commands take it, with its model of the same name beside it (--arm)."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        if self.arm is not None:
            return self._chain(self.arm)
        if self.save is not None:
            check_name(self.save, "model name", ModelError)
        for path, ending in ((self.plot, PICTURE), (self.record, RECORDING)):
            if path is not None:
                ensure_writable(path, ending)
        with Console(stderr=True).status("measuring") as status, arguments_as_options(self):
            began = time.perf_counter()

            def progress(stage: str) -> None:
                nonlocal began
                status.update(stage)
                began = time.perf_counter()

            found = self._identified(progress)
            seconds = time.perf_counter() - began
        kept = self.save is not None and (self.anyway or not found.doubts)
        file = ModelStore(self.store).save(found.model, self.save).path if self.save and kept else None
        if self.plot is not None:
            save_figure(found.plot(), self.plot)
        if self.record is not None:
            _record(found, self.record)
        report = _report(found, seconds, file)
        if self.json:
            print_json(report)
        else:
            _print(report, found.estimate, "" if kept or self.save is None else self.save)
        return 1 if found.doubts else 0

    def _chain(self, arm: str) -> int:
        """Identifies another arm than the thesis's."""
        from dtwin.api.arm.identification import identify_arm  # only other arms need their readers
        from dtwin.commands.identification.chain import report

        if self.log is None:
            raise ParameterError("--arm: expected a log, from which the arm is identified")
        with Console(stderr=True).status("reading") as status, arguments_as_options(self):
            identified = identify_arm(
                arm,
                (self.log, *self.also),
                tip=self.tip,
                columns=self.columns,
                load=self.load,
                out=self.out,
                urdf=self.urdf,
                mjcf=self.mjcf,
                arm_out=self.arm_out,
                progress=status.update,
            )
        report(identified.found, identified.samples, self.json)
        return 0

    def _identified(self, progress: Callable[[str], None]) -> Identified:
        shared: dict[str, Any] = {
            "free": self.free,
            "friction": self.friction,
            "prior": self.prior,
            "loss": self.loss,
            "known": self.known,
            "seed": self.seed,
            "progress": progress,
        }
        if self.log is not None:
            if len(self.payload) > 1:
                raise ParameterError(f"--payload: expected one mass of a box for a log, got {len(self.payload)}")
            return identify(self.log, payload=self.payload[0] if self.payload else None, **shared)
        return identify_experiment(
            noise=self.noise,
            noise_kind=self.noise_kind,
            payload=self.payload,
            payload_model=self.payload_model,
            optimise=self.optimise,
            start=self.start,
            set=self.set,
            machine=self.machine,
            **shared,
        )


def _record(found: Identified, path: Path) -> None:
    from dtwin.view.identification import write_identification

    rows = [(name, value, found.intervals[name]) for name, value in found.values.items()]
    new, old = found.held_out, found.before
    motions = {"measured": new.measured, "before": old.predicted, "identified": new.predicted}
    write_identification(path, PERIOD, motions, rows, found.estimate.problem.shared, found.estimate.correlation)


def _report(found: Identified, seconds: float, file: Path | None) -> dict[str, Any]:
    estimate, truth = found.estimate, found.truth
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
        "fit": found.held_out.fit.tolist(),
        "residual_white": estimate.whiteness.white,
        "bic": estimate.bic,
        "starts": estimate.starts,
        "seconds": seconds,
        "model_file": str(file) if file else None,
    }
    criterion = {"criterion": found.criteria} if found.criteria else {}
    return report | criterion | ({"doubts": found.doubts} if found.doubts else {})


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
