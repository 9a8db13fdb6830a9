"""What the monitoring service has said since it was last drawn."""

from __future__ import annotations

from dtwin.bus.twin_messages import MonitoringResiduals, MonitoringVerdict
from dtwin.bus.verdicts.opinion import Opinion, is_known


class Verdicts:
    """Collects residuals and verdicts until they are drawn; the last verdict counts only as long as it is fresh."""

    def __init__(self) -> None:
        self._opinion = Opinion()
        self._known = True
        self._residuals: list[MonitoringResiduals] = []
        self._verdicts: list[MonitoringVerdict] = []

    def take_residuals(self, message: MonitoringResiduals, now: float) -> None:
        """Takes residuals."""
        self._residuals.append(message)

    def take_verdict(self, message: MonitoringVerdict, now: float) -> None:
        """Takes a verdict that came at a time of a clock that only grows, s."""
        self._opinion.update(message, now)
        self._verdicts.append(message)

    def judge(self, time: float, now: float, monitored: bool) -> None:
        """Adds that nothing is known any more, once the last verdict counts no longer.

        Args:
            time: plant time of the last sample, s.
            now: time of the clock that only grows, s.
            monitored: whether anybody watches the arm.
        """
        self._opinion.sample(time, now)
        verdict = self._opinion.current(now)
        known = is_known(verdict)
        if monitored and self._known and not known:
            self._verdicts.append(verdict)
        self._known = known

    def taken(self) -> tuple[list[MonitoringResiduals], list[MonitoringVerdict]]:
        """What has come since the last call."""
        taken = self._residuals, self._verdicts
        self._residuals, self._verdicts = [], []
        return taken
