"""What is checked before the first target is sent: joints, start, and the plan in our own simulation."""

from __future__ import annotations

import numpy as np

from skillcli.errors import SkillError
from skillcli.execution.driver import Driver, DriverError, JointState, ObjectSource, order_of
from skillcli.execution.observed import ObservedArm
from skillcli.robots.robot import Robot
from skillcli.simulation.foresight import Foresight
from skillcli.trajectories import SAFETY_LIMITS, Array, Trajectories

AT_START = 0.05  # rad, by which a joint may be off its start
DRAWN_START = 0.2  # rad, the same where a simulated domain draws the start


def check_joints(state: JointState, robot: Robot) -> None:
    """Refuse an arm whose joints are not those of the robot file in the same order.

    Raises:
        DriverError: names or order differ, or a number is missing or not finite.
    """
    wanted = robot.description.joints
    if order_of(state.names, wanted) != tuple(range(len(wanted))):
        raise DriverError(
            f"the arm tells its joints in another order; expected {', '.join(wanted)}; got {', '.join(state.names)}",
            "let the driver tell them in the order of the robot file: see its settings",
        )
    if state.position.shape != (len(wanted),) or not np.isfinite(state.position).all():
        raise DriverError(
            f"expected {len(wanted)} finite joint angles; got {np.array2string(state.position, precision=3)}",
            "does every encoder report?",
        )


def check_object(driver: Driver, observed: ObservedArm, task: str) -> None:
    """Refuse a driver that does not see the object of a task that has one.

    Raises:
        DriverError: it does not.
    """
    if not observed.has_object:
        return
    if not isinstance(driver, ObjectSource):
        raise DriverError(
            f"the {task} task needs to see its object, and this driver does not", "docs/drivers.md says how one can"
        )
    driver.object_pose()


def check_range(state: JointState, low: Array, high: Array) -> None:
    """Refuse an arm with a joint beyond the range of its robot file.

    Args:
        state: of the arm.
        low: (J,) rad, lowest angles.
        high: (J,) rad, highest angles.

    Raises:
        SkillError: a joint is beyond; perhaps its zero or its sign differs.
    """
    beyond = np.maximum(low - state.position, state.position - high)
    joint = int(np.argmax(beyond))
    if beyond[joint] > AT_START:
        raise SkillError(
            f"{state.names[joint]} is at {state.position[joint]:.2f} rad, outside of {low[joint]:.2f} .. {high[joint]:.2f}",
            "compare zero and sign of this joint with the robot file, or move it back by hand",
        )


def check_free(foresight: Foresight, position: Array) -> None:
    """Refuse an arm that touches something by our model where it stands.

    Raises:
        SkillError: it does.
    """
    if touched := foresight.touches(position):
        raise SkillError(
            f"where the arm stands, the model says {touched}",
            "move the arm away by hand, or correct model, base or table in the robot file",
        )


def check_start(state: JointState, start: Array, within: float) -> None:
    """Refuse an arm that is not where the plan begins.

    Args:
        state: of the arm.
        start: (J,) rad.
        within: rad.

    Raises:
        SkillError: a joint is farther off.
    """
    off = np.abs(state.position - start)
    joint = int(np.argmax(off))
    if off[joint] > within:
        raise SkillError(
            f"the arm is not at the start: {state.names[joint]} is at {state.position[joint]:.3f} rad, "
            f"expected {start[joint]:.3f} within {within:g}",
            "--home moves it there slowly, and looks for collisions first",
        )


def check_plan(planned: Trajectories) -> None:
    """Refuse a plan that violates a safety limit in our own simulation.

    Raises:
        SkillError: it does.
    """
    if planned.within_limits.all() and planned.stable.all():
        return
    route = int(np.argmin(planned.within_limits & planned.stable))
    violated = [name for name, steps in planned.violation_steps.items() if steps[route]] or ["stability"]
    raise SkillError(
        f"in our own simulation route {route + 1} violates {', '.join(violated)}, one of {', '.join(SAFETY_LIMITS)}",
        "compose another plan: it is not sent to an arm",
    )
