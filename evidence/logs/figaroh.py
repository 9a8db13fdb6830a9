"""figaroh's identification of the same files, for comparison, where it is installed: `pip install figaroh`."""

from __future__ import annotations

import contextlib
import io
import types
import warnings
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.identification.chain.baseline import filtered
from dtwin.identification.chain.design import Filtering
from dtwin.measurements.measurement import Measurement

ABSENT = "figaroh is not installed: pip install figaroh"


class Figaroh:
    """figaroh's base parameters and friction, fitted as its weighted least squares does.

    Its regressor has viscous and dry friction, rotors and offsets; columns that do nothing and those that are
    combinations of others are left out by its functions; joints weigh by the size of their residuals.
    """

    def __init__(self, urdf: Path, arm: Arm, measurements: Sequence[Measurement], gain: Array) -> None:
        """Fits it.

        Args:
            urdf: the arm's description.
            arm: the chain, which figaroh has to read in the same way.
            measurements: motion with an empty hand.
            gain: N m (N) per unit of the log, (n,).

        Raises:
            ImportError: it or what it needs is not installed, or it reads more joints than the chain has.
        """
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")  # its bindings warn while they are loaded
            import pinocchio
            from figaroh.tools import qrdecomposition, regressor
        model = pinocchio.buildModelFromUrdf(str(urdf))
        if model.nv != len(arm) or model.nq != len(arm):
            raise ImportError(f"figaroh reads {model.nv} joints, the chain has {len(arm)}")
        self.name = f"figaroh {metadata.version('figaroh')}"
        self._robot = types.SimpleNamespace(model=model, data=model.createData())
        self._of, self._gain = regressor.build_regressor_basic, gain
        columns, torque = self._equations(measurements)
        names = {str(k): 0.0 for k in range(columns.shape[1])}
        idle, left = regressor.get_index_eliminate(columns, names)
        self._kept = np.setdiff1d(np.arange(columns.shape[1]), idle)
        base = qrdecomposition.get_baseIndex(columns[:, self._kept], left)
        self._kept = self._kept[np.array(base)]
        matrix, rows = columns[:, self._kept], len(torque) // len(arm)
        plain = np.linalg.lstsq(matrix, torque)[0]
        sizes = np.sqrt(np.mean((torque - matrix @ plain).reshape(len(arm), rows) ** 2, axis=1))
        weight = np.repeat(1.0 / sizes, rows)
        self._solution: Array = np.linalg.lstsq(matrix * weight[:, None], torque * weight)[0]

    def predicted(self, measurement: Measurement) -> tuple[Array, Array]:
        """Torque of a measurement as measured and as predicted, (N, n)."""
        columns, torque = self._equations([measurement])
        n = len(self._gain)
        return torque.reshape(n, -1).T, (columns[:, self._kept] @ self._solution).reshape(n, -1).T

    def _equations(self, measurements: Sequence[Measurement]) -> tuple[Array, Array]:
        """figaroh's regressor and the torques, joint after joint."""
        q, v, a, effort = (np.concatenate(part) for part in zip(*filtered(measurements, Filtering()), strict=True))
        names = ("has_friction", "has_actuator_inertia", "has_joint_offset", "is_joint_torques")
        settings: dict[str, object] = dict.fromkeys(names, True) | {"act_idxv": list(range(q.shape[1]))}
        return self._of(self._robot, q, v, a, settings), (effort * self._gain).T.ravel()
