from pathlib import Path

import numpy as np
import pytest

from dtwin.campaign.spread import Workforce
from dtwin.emulation.machine.files import machine_of
from evidence.identification import mass
from evidence.identification.groups import run_groups
from evidence.identification.noise import noise_trials
from evidence.identification.pages import identification_report
from evidence.identification.standard import FREE


def test_the_number_of_processes_does_not_change_the_outcome() -> None:
    alone = run_groups(noise_trials(2, (0.002, 0.010)), Workforce(1))
    spread = run_groups(noise_trials(2, (0.002, 0.010)), Workforce(2))
    assert [group.outcomes for group in alone] == [group.outcomes for group in spread]
    for group in alone:
        assert all(o.converged and o.second_converged and o.white for o in group.outcomes)
        assert {o.values["K1"] for o in group.outcomes if o.values is not None} != {group.truth["K1"]}
    lower, higher = (group.bounds for group in alone)
    assert lower is not None
    assert higher is not None
    assert higher["K1"] == pytest.approx(5 * lower["K1"])
    assert run_groups([]) == []


def test_a_wrong_load_scales_all_forces(monkeypatch: pytest.MonkeyPatch) -> None:
    """10 g too few taken for 200 g: K and D come out too large by 200/190."""
    monkeypatch.setattr(mass, "EXCESSES", (-0.010,))
    (heavy,) = run_groups(mass.mass_trials(2), Workforce(1))
    assert heavy.label == "190 g"
    for name in ("K1", "K2", "K3", "D1", "D2", "D3"):
        assert heavy.errors(name).mean() / heavy.truth[name] == pytest.approx(10 / 190, abs=0.005)


def test_the_truth_of_a_machine_is_what_it_was_made_to() -> None:
    [group] = run_groups(noise_trials(1, (0.001,), machine=machine_of("weak-motor")), Workforce(1))
    assert group.truth["K2"] == pytest.approx(0.9 * 0.0118 / 0.075)
    assert abs(group.errors("K2")[0]) < 0.01 * group.truth["K2"]


def test_a_refusal_is_reported_and_the_report_is_whole(tmp_path: Path) -> None:
    # Noise that drowns the motion: nothing is identified, and the page says why.
    groups = run_groups(noise_trials(2, (0.005, 2.0)), Workforce(1))
    assert all(outcome.values is None for outcome in groups[1].outcomes)
    assert "no motion" in groups[1].outcomes[0].reason or "diverged" in groups[1].outcomes[0].reason
    report = identification_report("A title", "The setup.", "Found before.", "The conclusion.", groups)
    for part in ("# A title", "The setup.", "Found before.", "The conclusion.", "- refused: "):
        assert part in report.text
    assert report.text.count("\n| K1 |") == 1
    text = report.write(tmp_path / "new" / "folder", "").read_text()
    assert text.count("<svg") == text.count("<figcaption>") == 1
    assert len(groups[0].truth) == len(FREE)
    assert np.isnan(groups[1].root_mean_square("K1"))
