"""How the reports of the monitoring experiments write numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from evidence.monitoring.trial import FaultOutcome


def percent(share: float | None) -> str:
    """A share in percent; nothing for None."""
    return "" if share is None else f"{100 * share:.3g} %"


def number(value: float | None) -> str:
    """Two decimals; a dash for what did not happen."""
    return "-" if value is None or math.isinf(value) else f"{value:.2f}"


def median_and_largest(values: Sequence[float]) -> list[str]:
    """Two numbers with two decimals; nothing where there are no values."""
    return [f"{np.median(values):.2f}", f"{max(values):.2f}"] if values else ["", ""]


def figures_of(outcomes: Sequence[FaultOutcome], alarms: int, hours: float) -> dict[str, Any]:
    """What is told to programs of trials, of the false alarms in a plant time (h) without a fault among them."""
    return {"runs": outcomes, "false_alarms": alarms, "fault_free_hours": hours}
