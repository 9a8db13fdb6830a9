"""Whether healthy arms with effects around them are stopped where their drives and encoders are known.

Run by `scripts/outside --known`, with the number of the first machine. Each effect has a machine of its own. Of the
encoders the controller knows what a log of work with the effect shows, as after `dtwin commission`: an effect may
coarsen them, so that what the drawn ones never do is no lie.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings import Compensation, ControlSettings
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.machine.files import machine_of
from dtwin.identification.machine.record import EncoderCheck
from dtwin.identification.machine.sensors import check_sensors
from dtwin.logs.collecting import RunLog
from dtwin.parameters import ArmParameters
from dtwin.run.loop import run, tick_count
from dtwin.simulation.proposal import pull, repeats, with_rotors
from dtwin.twin.effects import Effects
from evidence.recovery.expected import made_of
from tests.outside.around import Around, Outcome, outcome
from tests.outside.table import EFFECTS
from tests.outside.watched import LEARNED_FROM

_WORK: Final = 60.0
"""Work that may not be stopped, s."""
_OTHER_BOXES: Final = 5000
"""What is added to a machine's number for the boxes and the noise of the log."""


class Known(NamedTuple):
    """A drawn machine with an effect around it: its number, and the effect's name."""

    number: int
    what: str


def shown_by(encoders: Sequence[EncoderCheck], arm: ArmParameters, effects: Effects) -> Compensation:
    """What the controller takes into account of true drives, and of encoders as a log shows them."""
    drives = zip(arm.coulomb, effects.stiction, arm.voltage_constant, effects.dead_zone, encoders, strict=True)
    pulls = (pull(mu + more + constant * zone, encoder.step) for mu, more, constant, zone, encoder in drives)
    return Compensation(repeats=tuple(map(repeats, encoders)), pull=tuple(pulls))


def worked(item: Known, learned: float = LEARNED_FROM) -> tuple[Compensation, Outcome]:
    """What a log (s) of work with an effect shows, and what becomes of other work under blocks that know it."""
    machine, effect = machine_of(str(item.number)), EFFECTS[item.what]
    arm, effects = made_of(machine, ArmParameters())
    plain, log = ControlSettings(law="cascade", model=with_rotors(arm, effects)), RunLog()
    plant = Around(Emulation(machine=machine, seed=item.number + _OTHER_BOXES), effect, item.number)
    run(plant, EmbeddedController(plain), tick_count(learned), record=log.append)
    known = shown_by(check_sensors(log.freeze()).encoders, arm, effects)
    settings = replace(plain, compensation=known)
    return known, outcome(effect, seed=item.number, duration=_WORK, machine=machine, noise=0.0, settings=settings)


def main(first: int) -> None:
    """Prints the table, and what was asked."""
    print("| machine | effect | repeats | pull | boxes | lost | fastest rad/s | stopped |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    stops = 0
    for number, what in enumerate(EFFECTS, first):
        known, found = worked(Known(number, what))
        stopped = found.stopped < _WORK
        repeated, pulled = ", ".join(map(str, known.repeats)), ", ".join(f"{one:.2f}" for one in known.pull)
        counted = f"{found.delivered} | {found.lost} | {found.fastest:.1f} | {int(stopped)}"
        print(f"| {number} | {what} | {repeated} | {pulled} | {counted} |", flush=True)
        stops += stopped
    print(f"\nNo healthy arm is stopped: {stops} of {len(EFFECTS)} were")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
