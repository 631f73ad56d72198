"""A robot file for a model that has none: what can be found out is filled in, what was guessed and what is unknown is said."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np

from skillcli.errors import UsageError
from skillcli.robots.base import places_of_hand, rotated, stand_on_table, turned_forward
from skillcli.robots.chain import Chain, find_chain
from skillcli.robots.config import Description
from skillcli.robots.hand import Hand, find_hand
from skillcli.robots.inverse_kinematics import Kinematics
from skillcli.robots.mjcf import MENAGERIE, balance_inertia, compile_model, drop_missing_files, find_model, quietly, read_mjcf
from skillcli.robots.posture import held
from skillcli.robots.robot import Robot, build_described
from skillcli.robots.servos import find_servos, torque_of
from skillcli.robots.shapes import CORNERS
from skillcli.robots.start import POINTS_DOWN, find_start
from skillcli.robots.toml_text import RobotText
from skillcli.robots.tuning import BANDWIDTHS, Response, propose_gains, step_responses
from skillcli.trajectories import Array

DISTANCES = (0.45, 0.4, 0.5, 0.35, 0.55, 0.3, 0.25)  # of the start from the base, as shares of the reach
HEIGHTS = (0.17, 0.25, 0.33)  # of the start above the table, as shares of the reach
NEAR = 0.2  # a place that no random posture comes as near to as this share of the reach is out of reach
AROUND = 0.08  # places that have to be within reach lie this far around the start, as a share of the reach
FINGER_GAPS = (0.0, 0.01, 0.02, 0.04, 0.06)  # m that our finger is mounted farther out where it would stand in the hand
ASTRAY = 0.5  # share of a step that a joint may be off in the end, before its servo counts as none
SHORTEST, LONGEST = 0.2, 5.0  # m: the reach of an arm on a table, our finger of 13 cm included, lies between
NARROWEST, WIDEST = 0.2, 50.0  # rad: the widest range of an arm's joints lies between
TIMED_STEPS, REPEATS = 50, 8


@dataclass(frozen=True)
class NewRobot:
    """A proposal.

    Attributes:
        text: of the robot file.
        joints: of the arm, from the base to the hand.
        guessed: what was decided, and why.
        unknown: what only a person can know.
    """

    text: str
    joints: tuple[str, ...]
    guessed: tuple[str, ...]
    unknown: tuple[str, ...]


@dataclass(frozen=True)
class _Draft:
    """What is known so far."""

    path: Path  # of the robot file
    keys: dict[str, Any]  # of its description
    robot: Robot
    start: tuple[float, ...] | None

    @property
    def posture(self) -> Array:
        """The start, or home where none was found, (n,) rad."""
        return np.array(self.start or self.robot.home)


def propose_robot(model: str, file: Path) -> NewRobot:
    """Find out what a robot file has to say of a model.

    Args:
        model: path of an MJCF or URDF file, or `menagerie:NAME`.
        file: that the text is for; the model is named relative to it.

    Raises:
        UsageError: it cannot be read, or holds no arm of 4 to 8 hinges; or no file for it would load.
    """
    source = find_model(Path(), model)
    with quietly():
        spec = read_mjcf(source)
        drop_missing_files(spec, source)
        balance_inertia(spec)
        chain = find_chain(spec)
        compiled = compile_model(spec, source)
        hand = find_hand(spec, compiled, chain.joints)
        text = RobotText(model if model.startswith(MENAGERIE) else _relative(source, file), chain.joints)
        keys = {"model": text.model, "joints": chain.joints, "gripper": _frame(hand), "finger": hand.finger}
        if (base := stand_on_table(spec, compiled, chain.joints)) is not None:
            keys["base"] = {"pos": base}
        torque = torque_of(compiled, chain.joints)
        draft = _draft_with_servos(file, keys, compiled, chain, torque)
        draft = _clear_of_the_hand(draft, hand)
    return _summarised(text, draft, chain, hand, _speeds(source, chain.joints), torque, compiled)


def _relative(source: Path, file: Path) -> str:
    """The model as the robot file names it."""
    try:
        return source.absolute().relative_to(file.absolute().parent).as_posix()
    except ValueError:
        return source.absolute().as_posix()


def _frame(hand: Hand) -> dict[str, Any]:
    return {"body": hand.body, "pos": hand.pos, "quat": hand.quat}


def _draft_with_servos(file: Path, keys: dict[str, Any], model: mujoco.MjModel, chain: Chain, torque: Array) -> _Draft:
    """The robot with its own servos where it has some, else with the stiffest proposed gains that answer a step well."""
    own = _servos(model, chain)
    if own is not None:
        draft = _draft_with_start(file, {**keys, **own})
        if _follows(step_responses(draft.robot, draft.posture)):
            return draft
    limits = {"force": tuple(float(x) for x in torque)} if np.isfinite(torque).all() else {}
    drafts = ({**keys, "gains": {**_gains(model, chain, torque, hertz), **limits}} for hertz in BANDWIDTHS)
    draft = _draft_with_start(file, next(drafts))
    while not _answers_well(draft) and (softer := next(drafts, None)) is not None:
        draft = _build(file, softer, draft.start)
    return draft


def _gains(model: mujoco.MjModel, chain: Chain, torque: Array, hertz: float) -> dict[str, Any]:
    return propose_gains(model, chain.joints, torque, hertz)._asdict()


def _answers_well(draft: _Draft) -> bool:
    return all(response.good for response in step_responses(draft.robot, draft.posture))


def _follows(responses: list[Response]) -> bool:
    """Whether every joint gets somewhere near where it is told to be."""
    return all(response.error <= ASTRAY for response in responses)


def _servos(model: mujoco.MjModel, chain: Chain) -> dict[str, Any] | None:
    """Which of the model's position servos drive the arm; None where a joint has none."""
    try:
        find_servos(model, chain.joints, None, None)
    except UsageError:
        several = [_first_servo(model, joint) for joint in chain.joints]
        return None if None in several else {"actuators": tuple(map(str, several))}
    return {}


def _first_servo(model: mujoco.MjModel, joint: str) -> str | None:
    """The first named position servo of a joint."""
    for i in range(model.nactuator):
        name = model.actuator(i).name
        try:
            if name:
                find_servos(model, [joint], [name], None)
                return str(name)
        except UsageError:
            continue
    return None


def _draft_with_start(file: Path, keys: dict[str, Any]) -> _Draft:
    """The robot, and a start with its gripper down before it where there is one."""
    draft = _build(file, keys, None)
    placed = _with_best_start(draft)
    if placed.start is None and (quat := turned_forward(Kinematics(draft.robot))) is not None:
        pos = rotated(keys.get("base", {}).get("pos", (0.0, 0.0, 0.0)), quat)
        turned = _with_best_start(_build(file, {**keys, "base": {"pos": pos, "quat": quat}}, None))
        return placed if turned.start is None else turned
    return placed


def _with_best_start(draft: _Draft) -> _Draft:
    """The robot with the start that points down best, as it is where there is none."""
    kinematics, reach = Kinematics(draft.robot), draft.robot.workspace.reach
    cube = CORNERS * AROUND * reach
    known = places_of_hand(kinematics)
    best: tuple[float, tuple[float, ...]] | None = None
    for height, distance in product(HEIGHTS, DISTANCES):
        if best is not None and distance == DISTANCES[0]:
            break  # another height, for an arm that cannot point straight down, would not better it
        middle = np.array([distance * reach, 0.0, height * reach])
        if np.linalg.norm(known - middle, axis=1).min() > NEAR * reach:
            continue  # a search would find nothing, but take long
        start = find_start(kinematics, middle, middle + cube, None)
        if start is None:
            continue
        down = -float(kinematics.gripper(np.array(start))[1][2])
        best = max(best or (down, start), (down, start))
        if down >= POINTS_DOWN:
            break
    return draft if best is None else _build(draft.path, draft.keys, best[1])


def _build(file: Path, keys: dict[str, Any], start: tuple[float, ...] | None) -> _Draft:
    keys = keys if start is None else {**keys, "start": start}
    return _Draft(file, keys, build_described(file, file.stem, Description.model_validate(keys)), start)


def _clear_of_the_hand(draft: _Draft, hand: Hand) -> _Draft:
    """Our finger mounted farther out, where it would stand in the hand."""
    if hand.finger is not None:
        return draft
    for gap in FINGER_GAPS:
        turned = np.zeros(9)
        mujoco.mju_quat2Mat(turned, np.array(hand.quat))
        pos = tuple(round(float(x), 5) for x in np.array(hand.pos) + gap * turned.reshape(3, 3)[:, 2])
        tried = draft if gap == 0 else _build(draft.path, {**draft.keys, "gripper": {**_frame(hand), "pos": pos}}, draft.start)
        if not any("finger" in note for note in tried.robot.notes):
            return tried
    return draft


def _speeds(source: Path, joints: tuple[str, ...]) -> tuple[float, ...] | None:
    """Largest speeds that a URDF says, (n,) rad/s; MJCF has no place for them."""
    try:
        root = ElementTree.parse(source).getroot()
    except ElementTree.ParseError:
        return None
    limit_of = {joint.get("name"): joint.find("limit") for joint in root.iter("joint")} if root.tag == "robot" else {}
    limits = [limit_of.get(name) for name in joints]
    speeds = [float(limit.get("velocity", 0)) for limit in limits if limit is not None]
    return tuple(speeds) if len(speeds) == len(joints) and all(speed > 0 for speed in speeds) else None


def _summarised(
    text: RobotText,
    draft: _Draft,
    chain: Chain,
    hand: Hand,
    speeds: tuple[float, ...] | None,
    torque: Array,
    model: mujoco.MjModel,
) -> NewRobot:
    responses = step_responses(draft.robot, draft.posture)
    guessed = [f"the arm is the {len(chain.joints)} hinges from {chain.joints[0]} to {chain.joints[-1]}"]
    guessed += [f"another arm, from {first} to {last}, is left alone" for first, last in chain.others]
    guessed.append(f"the gripper is {hand.because}")
    unknown = ["the payload, and which frame is the tool's: check [gripper] against the arm's drawing"]
    if "base" in draft.keys:
        base = draft.keys["base"]
        done = ["moved to stand on the table at the origin"] if any(base["pos"]) else []
        done += ["turned to look along x"] if "quat" in base else []
        guessed.append(f"the base is {', and '.join(done)}")
    if "actuators" in draft.keys:
        guessed.append("joints have several position servos: the first of each is taken")
    if "gains" in draft.keys:
        if model.nu and _servos(model, chain) is not None:
            guessed.append("the model's own servos do not hold the arm: ours replace them")
        overshoot = max(response.overshoot for response in responses)
        largest_error = max(response.error for response in responses)
        guessed.append(
            "gains are those of critically damped servos for the inertia of the links; "
            f"a step overshoots by {100 * abs(overshoot):.0f} %, and ends {100 * largest_error:.0f} % off"
        )
    if not np.isfinite(torque).all():
        where = "gains.force" if "gains" in draft.keys else "forcerange of the model's servos"
        unknown.append(f"the largest torque of each joint: {where}, of its data sheet, in N·m")
    if not _follows(responses):
        unknown.append("why the arm does not go where it is told to: something else drives or blocks it, so it will not train")
    widest = max((float(np.ptp(model.joint(name).range)) for name in chain.joints if model.joint(name).limited), default=np.pi)
    if not NARROWEST < widest < WIDEST:
        unknown.append(f"the unit of the joints' ranges, now {widest:.2g} rad at most: see <compiler angle> of the model")
    reach = draft.robot.workspace.reach
    if not SHORTEST < reach < LONGEST:
        unknown.append(f"the unit of length: in m, as MuJoCo takes it, the arm reaches {reach:.3g} m")
    if speeds is None:
        unknown.append("the largest speed of each joint: speed_limit, of its data sheet, in rad/s")
    else:
        guessed.append("speed_limit is what the URDF says")
    if draft.start is None:
        unknown.append("a start: none was found with the gripper down before the base; is base.quat right?")
    if meshes := _mesh_cost(draft):
        guessed.append(meshes)
    guessed += [f"loading it: {note}" for note in draft.robot.notes]
    return NewRobot(text.written(draft.keys, speeds, guessed, unknown), chain.joints, tuple(guessed), tuple(unknown))


def _mesh_cost(draft: _Draft) -> str:
    """What collision with meshes costs, in words; empty where no mesh collides."""
    model = draft.robot.model
    meshes = (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) & ((model.geom_contype | model.geom_conaffinity) > 0)
    if not meshes.any():
        return ""
    without = draft.robot.scene.copy()
    for geom in without.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
            geom.contype = geom.conaffinity = 0
    bare, seconds = without.compile(), [math.inf, math.inf]
    for _ in range(REPEATS):  # by turns, and the shortest counts: other work on the machine only ever adds
        seconds = [min(least, _seconds(draft, variant)) for least, variant in zip(seconds, (model, bare), strict=True)]
    share = 100 * max(0.0, 1 - seconds[1] / seconds[0])
    return f"{int(meshes.sum())} meshes collide as their convex hulls, which takes {share:.0f} % of a step"


def _seconds(draft: _Draft, model: mujoco.MjModel) -> float:
    """What some steps at the start take."""
    data = held(model, draft.robot.names, tuple(draft.posture))
    began = time.perf_counter()
    for _ in range(TIMED_STEPS):
        mujoco.mj_step(model, data)
    return time.perf_counter() - began
