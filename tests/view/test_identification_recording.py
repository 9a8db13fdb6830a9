"""Recordings of an identification."""

from pathlib import Path

import numpy as np

from dtwin.view.identification import write_identification
from tests.view.test_write import ranges_of


def test_axes_hold_the_measured_motion_whatever_a_model_predicts(tmp_path: Path) -> None:
    measured = np.linspace((-1.2, 0.3, 0.0), (0.4, 2.6, 1.0), 20)
    motions = {"measured": measured, "before": 100.0 * measured, "identified": measured + 0.01}
    write_identification(tmp_path / "found.rrd", 0.01, motions, [("K1", 0.2, 0.01)], ["K1"], np.eye(1))
    assert ranges_of(tmp_path / "found.rrd") == {f"motion/joint_{j}": (-2.0, 3.0) for j in (1, 2, 3)}
