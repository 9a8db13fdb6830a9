"""figaroh beside the identification: fitted where it is installed, and told where it is not."""

import sys
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.urdf import read_urdf
from dtwin.identification.chain.identify import unexplained
from evidence.logs import real
from evidence.logs.figaroh import Figaroh
from tests.support.chains import drawn_urdf, measured


def test_figaroh_explains_what_it_has_words_for(tmp_path: Path) -> None:
    pytest.importorskip("figaroh")
    file = tmp_path / "drawn.urdf"
    file.write_text(drawn_urdf(3, 11))
    arm = read_urdf(file)
    peer = Figaroh(file, arm, [measured(arm, 20.0, 1)], np.ones(3))
    assert (unexplained(*peer.predicted(measured(arm, 12.0, 7))) < 0.2).all()


def test_what_is_absent_raises_an_import_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("figaroh", "figaroh.tools"):
        monkeypatch.setitem(sys.modules, name, None)
    file = tmp_path / "drawn.urdf"
    file.write_text(drawn_urdf(2, 11))
    arm = read_urdf(file)
    with pytest.raises(ImportError):
        Figaroh(file, arm, [measured(arm, 12.0, 1)], np.ones(2))


def test_shares_stand_side_by_side_joint_by_joint() -> None:
    assert real.Tested("a", (0.1, 0.2), (0.3, 0.4)).joints() == [(0.1, 0.3), (0.2, 0.4)]
    assert real.Tested("a", (0.1,), (0.3,), (0.5,)).joints() == [(0.1, 0.3, 0.5)]
