"""An arm among bodies that follows joint paths exactly known to it, for tests of grip and contact."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from dtwin.emulation.contact.bodies import Bodies
from dtwin.emulation.machine.sections import Contact
from dtwin.emulation.plant import Plant
from dtwin.parameters import PERIOD, PICKUP, PLACES, ArmParameters, JointVector
from dtwin.twin.dynamics import inverse_dynamics
from tests.support.driven import Driven, to, triple

Array = npt.NDArray[np.float64]
_KP, _KD, _KI = np.array((200.0, 500.0, 300.0)), np.array((20.0, 20.0, 20.0)), np.array((75.0, 200.0, 150.0))


def way_point(name: str) -> Array:
    """Joint angles of a point of the way (rad), as the planner block knows them."""
    planner = Driven("PATH_PLANNER")
    planner.fire("TARGET", **to(name), **triple("THETA", PICKUP.theta))
    planner.fire("REQ", **triple("THETA", PICKUP.theta))
    return np.array([planner[f"THETA_T{joint}"] for joint in (1, 2, 3)])


def ways() -> dict[str, list[Array]]:
    """Joint angles of all points of the ways from above the pickup point to the places, rad."""
    return {
        colour: [*map(way_point, ("between", "behind", f"near {colour}", f"above {colour}")), np.array(place.theta)]
        for colour, place in PLACES.items()
    }


class Hand:
    """Arm, gripper and one box, under computed torque of a model that is right, and paths of fifth order.

    Args:
        contact: friction of pads and bodies.
        mass: mass of the box, kg.
        at: joint angles at the start, rad.
        box: centre of the box, m.
    """

    def __init__(
        self,
        contact: Contact,
        mass: float,
        at: JointVector = PICKUP.theta,
        box: tuple[float, float, float] = (0.2, -0.002, -0.2),
    ) -> None:
        self.bodies = Bodies(contact)
        self.plant = Plant(bodies=self.bodies)
        self.plant.reset(at)
        self.bodies.put(0, box, mass)
        self.mass, self.gripper = mass, 3.0
        self.carries = False
        self.each: Callable[[], None] = lambda: None
        self._target, self._sum = np.array(at), np.zeros(3)
        self._parameters = np.array(ArmParameters().vector())
        self._constant = np.array(ArmParameters().voltage_constant)

    def hold(self, duration: float) -> None:
        for _ in range(round(duration / PERIOD)):
            self._tick(self._target, np.zeros(3), np.zeros(3))

    def move(self, goal: Array, duration: float) -> None:
        start, way = self._target, goal - self._target
        self._sum[:] = 0.0
        ticks = round(duration / PERIOD)
        for tick in range(1, ticks + 1):
            s = tick / ticks
            self._tick(
                start + way * (10 * s**3 - 15 * s**4 + 6 * s**5),
                way * (30 * s**2 - 60 * s**3 + 30 * s**4) / duration,
                way * (60 * s - 180 * s**2 + 120 * s**3) / duration**2,
            )
        self._target = goal

    def grip(self) -> None:
        self.gripper = -3.0
        self.hold(1.0)
        self.carries = True

    def offset(self) -> Array:
        """Position of the box relative to the tip, in the plane of the arm, m; link 3 is level."""
        x, y = self.plant.tip()
        box = self.bodies.position(0)
        return np.array((box[0] - x, box[2] - y))

    def _tick(self, theta: Array, omega: Array, alpha: Array) -> None:
        plant = self.plant
        error = theta - np.array(plant.theta)
        self._sum += error * PERIOD
        wanted = alpha + _KP * error + _KI * self._sum + _KD * (omega - np.array(plant.omega))
        load = self.mass if self.carries else 0.0
        torque = inverse_dynamics(np.array(plant.theta), np.array(plant.omega), wanted, self._parameters, load)
        first, second, third = np.clip(torque / self._constant, -8.0, 8.0).tolist()
        plant.apply((first, second, third, self.gripper))
        plant.advance(PERIOD)
        self.each()
