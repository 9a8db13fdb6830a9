"""All attacks on a cell in each of its settings: what was believed, and what was told."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from dtwin.campaign.spread import Progress
from dtwin.errors import CommunicationError
from evidence.report import Report, page, table
from evidence.siege.attacks import ATTACKS, INTRUDERS, Attack
from evidence.siege.stage import SETTINGS, TOLD, Setting, Stage
from evidence.soak.cell import cell_name, wait

DENIED: Final = "by the router"
"""Who refuses what never reaches a service of a secured cell; Zenoh tells nobody of it."""


@dataclass(frozen=True, slots=True)
class Repelled:
    """What came of an attack.

    Attributes:
        attack: its name.
        setting: how the cell was joined.
        believed: what was believed, obeyed or kept from somebody, "" for nothing.
        told: who told of it, "" for nobody.
        seconds: how long it took, s.
    """

    attack: str
    setting: Setting
    believed: str
    told: str
    seconds: float

    @property
    def passed(self) -> bool:
        """Whether the cell believed nothing and told of it."""
        return not self.believed and bool(self.told)


@dataclass(frozen=True, slots=True)
class HostileRun:
    """What came of all attacks."""

    attacks: tuple[Repelled, ...]

    @property
    def passed(self) -> bool:
        """Whether none got through, and all were told."""
        return all(attack.passed for attack in self.attacks)

    def report(self) -> Report:
        """The attacks in a table."""
        rows = [[a.attack, a.setting, a.believed or "no", a.told or "no", f"{a.seconds:.1f} s"] for a in self.attacks]
        kept = sum(attack.passed for attack in self.attacks)
        text = f"{kept} of {len(self.attacks)} attacks were repelled and told."
        return page("Attacks on a cell", text, table(["attack", "setting", "believed", "told", "time"], rows))

    def figures(self) -> dict[str, Any]:
        """The same for programs."""
        through = [f"{a.setting}: {a.attack}" for a in self.attacks if not a.passed]
        return {"attacks": len(self.attacks), "repelled": len(self.attacks) - len(through), "through": through}


def hostile_run(progress: Progress, settings: Iterable[Setting] = SETTINGS) -> HostileRun:
    """Attacks a cell in each setting.

    Raises:
        CommunicationError: a cell does not come up.
    """
    found: list[Repelled] = []
    plan = {setting: (*ATTACKS, *(INTRUDERS if setting == "secured" else ())) for setting in settings}
    count = sum(map(len, plan.values()))
    for setting, attacks in plan.items():
        with tempfile.TemporaryDirectory() as folder, Stage(setting, Path(folder), cell_name()) as stage:
            for attack in attacks:
                found.append(repel(attack, stage))
                progress(len(found), count)
    return HostileRun(tuple(found))


def repel(attack: Attack, stage: Stage) -> Repelled:
    """Makes an attack and looks at what came of it."""
    before = stage.settled()
    began = time.monotonic()
    try:
        believed = attack.action(stage) or stage.shown()
    except CommunicationError as error:
        believed = f"the operator is not answered: {error}"
    seconds = time.monotonic() - began
    told = "in the status" if wait(lambda: stage.refused() > before, 0.0 if attack.unheard else TOLD) else ""
    if not told and stage.setting == "secured":
        told = DENIED
    told = told or (f"by nobody: {attack.unheard}" if attack.unheard else "")
    return Repelled(attack.name, stage.setting, believed, told, seconds)
