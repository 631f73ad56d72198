"""Other robots: models of other make play the tasks as they are, and what does not fit is refused with a reason."""

from __future__ import annotations

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from worlds import JOINTS, SAWYER, make_env, target_robot

from skillcli.config.randomization import sample
from skillcli.errors import UsageError
from skillcli.robots.model_size import MAX_BYTES
from skillcli.robots.posture import gripper_and_axes
from skillcli.robots.robot import Robot, load_robot
from skillcli.simulation.arm_environment import ArmEnvironment
from skillcli.simulation.domains import find_domain
from skillcli.tasks.point.settings import PointTask
from skillcli.tasks.push.settings import PushTask
from skillcli.tasks.reach.settings import ReachTask
from skillcli.trajectories import Array

ROBOTS = Path(__file__).parent.parent / "robots"
REACH, PUSH = ReachTask(), PushTask()
TORQUE = (ROBOTS / "torque.toml").read_text(encoding="utf-8")
MODEL = (ROBOTS / "torque.xml").read_text(encoding="utf-8")
WITHOUT_GAINS = TORQUE.split("[gains]")[0]
NAMES = re.findall(r'<joint name="(\w+)"', MODEL)


@pytest.fixture(params=["torque", "servo", "meshes"])
def robot(request: pytest.FixtureRequest) -> Robot:
    return target_robot(ROBOTS / f"{request.param}.toml")


def described(folder: Path, text: str = TORQUE, model: str = MODEL) -> Path:
    (folder / "torque.xml").write_text(model, encoding="utf-8")
    (folder / "robot.toml").write_text(text, encoding="utf-8")
    return folder / "robot.toml"


def driven_by(actuators: str, model: str = MODEL) -> str:
    """The torque arm with other actuators, written once for each joint as J."""
    each = "".join(actuators.replace("J", f'"{name}"') for name in NAMES)
    return re.sub("<actuator>.*</actuator>", f"<actuator>{each}</actuator>", model, flags=re.S).replace(
        '<motor ctrlrange="-1 1"/>', ""
    )


def env_on(robot: Robot, task: ReachTask | PushTask = REACH, num_envs: int = 2, delay: bool = False) -> ArmEnvironment:
    env = make_env(task, num_envs, 1, delay, robot)
    assert isinstance(env, ArmEnvironment)
    return env


def timestep_of(robot: Robot) -> float:
    spec = robot.arm_spec(robot.home, REACH.timestep, REACH.control_period)
    return float(spec.option.timestep)


def reply(env: ArmEnvironment, joint: int = 6, steps: int = 8) -> Array:
    """A joint after each control step when it is sent off at once, (steps + 1, N) rad."""
    env.reset(np.arange(env.num_envs), np.zeros(env.num_envs, dtype=np.int64))
    angles = [env.arms.joint_position[:, joint]]
    for _ in range(steps):
        env.step(np.eye(7)[[joint] * env.num_envs])
        angles.append(env.arms.joint_position[:, joint])
    return np.stack(angles)


@pytest.mark.parametrize("task", [REACH, PUSH])
def test_shapes_are_those_of_the_source_and_states_go_back(robot: Robot, task: ReachTask | PushTask) -> None:
    env, source = env_on(robot, task), make_env(task, 2, 1)
    actions = np.random.default_rng(0).uniform(-1, 1, (6, 2, 7))
    for action in actions[:3]:
        env.step(action)
    sim_states, shapes = env.save(np.arange(2)), {name: values.shape for name, values in env.recorded_state().items()}
    assert shapes == {name: values.shape for name, values in source.recorded_state().items()}
    assert env.observe().shape == source.observe().shape and env.applied.shape == (2, 7)
    ahead = [env.step(action).observation for action in actions[3:]]
    env.restore(np.array([1, 0]), sim_states[::-1])
    for seen, action in zip(ahead, actions[3:], strict=True):
        np.testing.assert_array_equal(env.step(action).observation, seen)


def test_an_arm_at_rest_stays_at_the_start_and_moves_as_it_is_told(robot: Robot) -> None:
    env = env_on(robot)
    np.testing.assert_allclose(env.arms.joint_position, [SAWYER.start("reach")] * 2, atol=1e-12)
    start = env.achieved_goal()
    for _ in range(20):
        env.step(np.zeros((2, 7)))
    sagging = robot.description.gravity_compensation is False
    assert (np.linalg.norm(env.achieved_goal() - start, axis=1) < (0.03 if sagging else 0.002)).all()
    for joint in range(7):
        moved = reply(env, joint)
        assert 0.2 < moved[-1, 0] - moved[0, 0] < 8 * REACH.action_limit


def test_the_finger_stands_where_the_source_has_it(robot: Robot) -> None:
    away = np.linalg.norm(robot.summary["gripper_from_source_m"])
    assert away < (0.01 if robot.path.stem == "servo" else 1e-6)  # the servo arm is 4 mm longer in two links
    assert {"rod", "palm"} <= {robot.model.geom(i).name for i in range(robot.model.ngeom)} or robot.description.finger


@pytest.mark.parametrize("towards", [0, 1])
def test_the_finger_pushes_the_box(robot: Robot, towards: int) -> None:
    task = PushTask(box_start=(0.65, 0.06 if towards else -0.06), box_size=(0.06, 0.06, 0.2))
    env = env_on(robot, task, 1)
    action = np.zeros((1, 7))
    action[0, 0] = 1.0 if towards else -1.0
    for _ in range(12):
        env.step(action)
    moved = env.achieved_goal()[0, 1] - task.box_start[1]
    assert (moved if towards else -moved) > 0.03


def test_its_own_floor_table_and_objects_are_left_behind(robot: Robot) -> None:
    model = robot.arm_spec(robot.home, PUSH.timestep, PUSH.control_period).compile()
    bodies = [model.body(i).name for i in range(model.nbody)]
    assert "robot/box" not in bodies and "robot/table" not in bodies and model.nkey == model.nsensor == 0
    fixed = model.body_weldid[model.geom_bodyid] == 0
    touching = [model.geom(i).name for i in np.flatnonzero(fixed & (model.geom_contype > 0))]
    assert touching == ["table"]


def test_joints_that_are_held_stay_and_others_are_locked() -> None:
    servo, meshes = (target_robot(ROBOTS / f"{name}.toml") for name in ("servo", "meshes"))
    assert servo.model.nu == 8 and servo.model.njnt == 9 and not servo.notes
    assert meshes.model.nu == 7 and meshes.model.njnt == 7
    missing, locked, _ = meshes.notes
    assert "8 mesh files are missing: 11 geoms left out, 3 of them could touch" in missing and "head_pan" in locked
    env = env_on(servo)
    pads = env.arms.batch.bind("qpos")[:, -2:]
    for action in np.random.default_rng(0).uniform(-1, 1, (20, 2, 7)):
        env.step(action)
    assert np.abs(pads).max() < 1e-3, "the gripper stays closed"


def test_servos_of_any_kind_are_brought_to_one_form() -> None:
    """Gear 2, gain 150: 600 N·m/rad at the joint; a control that is an angle of the joint, and a limit of 40 N·m doubled."""
    model = target_robot(ROBOTS / "servo.toml").model
    one = model.actuator("servo1")
    assert one.gainprm[0] == 600 and one.biasprm[:3].tolist() == [0, -600, -60] and one.forcerange.tolist() == [-80, 80]
    assert model.actuator_actnum[:7].tolist() == [0, 0, 0, 0, 1, 1, 1]
    motors = target_robot(ROBOTS / "torque.toml").model
    assert motors.actuator_gainprm[:, 0].tolist() == [900, 900, 700, 700, 400, 400, 400]
    assert motors.actuator_forcerange[:, 1].tolist() == [80, 80, 40, 40, 9, 9, 9], "gear times control range"


def test_what_a_motor_adds_to_its_joint_is_varied_with_it(tmp_path: Path) -> None:
    """Behind a gear of 10: 0.01 kg·m² and 0.02 N·m·s/rad are 1 and 2 at the joint, which has 0.6 and 1.5 of its own."""
    motor = '<motor joint=J gear="10" armature="0.01" damping="0.02" ctrlrange="-8 8"/>'
    env = env_on(target_robot(described(tmp_path, TORQUE, driven_by(motor))))
    np.testing.assert_allclose([env.arms.model.dof_armature[:7], env.arms.model.dof_damping[:7]], [[1.6] * 7, [3.5] * 7])
    env.randomize({"armature": np.full((2, 7), 2.0)}, np.random.default_rng(0))
    np.testing.assert_allclose(env.arms.batch.expand("dof_armature")[:, :7], 3.2)


def test_a_servo_in_one_form_pushes_with_the_force_it_had(tmp_path: Path) -> None:
    """force = gear (gain u + offset - 300 gear q - 20 gear v), here by hand."""
    general = '<general joint=J gear="2" gainprm="50" biastype="affine" biasprm="30 -300 -20" ctrlrange="-4 4"/>'
    robot = target_robot(described(tmp_path, WITHOUT_GAINS, driven_by(general)))
    model, data = robot.model, mujoco.MjData(robot.model)
    angle, speed, target = 0.2, 0.5, 0.1
    joint = model.joint("robot/elbow")
    data.qpos[joint.qposadr], data.qvel[joint.dofadr], data.ctrl[3] = angle, speed, target
    mujoco.mj_forward(model, data)
    u = (300 * 2 * target - 30) / 50  # rests at the target
    expected = 2 * (50 * u + 30 - 300 * 2 * angle - 20 * 2 * speed)
    assert data.qfrc_actuator[joint.dofadr[0]] == pytest.approx(expected)
    np.testing.assert_allclose(model.actuator_ctrlrange[3], [(50 * -4 + 30) / 600, (50 * 4 + 30) / 600])


@pytest.mark.parametrize(
    ("actuators", "number"),
    [
        ('<position joint=J kp="500"/><velocity joint=J kv="50"/>', 14),
        ('<position jointinparent=J kp="500" kv="50"/>', 7),
        ('<position joint=J kp="500" kv="50" timeconst="0.02"/>', 7),
        ('<motor joint=J/><position joint=J kp="500" kv="50"/>', 14),
    ],
)
def test_position_servos_are_found_and_what_else_acts_stays(actuators: str, number: int, tmp_path: Path) -> None:
    env = env_on(target_robot(described(tmp_path, WITHOUT_GAINS, driven_by(actuators))))
    assert env.arms.model.nu == number
    assert reply(env)[-1, 0] - SAWYER.start("reach")[6] > 0.2


def test_the_named_one_of_several_servos_is_taken(tmp_path: Path) -> None:
    model = driven_by('<position joint=J kp="500" kv="50"/><position joint=J kp="50"/>')
    numbers = iter(range(14))
    model = re.sub("<position", lambda _: f'<position name="p{next(numbers)}"', model)
    with pytest.raises(UsageError, match="'base_yaw' has 2 position servos: 'p0', 'p1'"):
        target_robot(described(tmp_path, WITHOUT_GAINS, model))
    named = 'actuators = ["p0", "p2", "p4", "p6", "p8", "p10", "p12"]\n' + WITHOUT_GAINS
    robot = target_robot(described(tmp_path, named, model))
    assert robot.model.actuator_gainprm[:, 0].tolist() == [500] * 7, "the others would pull to zero"


def test_latency_of_the_robot_and_of_a_domain_add_up(tmp_path: Path) -> None:
    late = target_robot(
        described(tmp_path, WITHOUT_GAINS, driven_by('<position joint=J kp="500" kv="50" delay="0.05" nsample="30"/>'))
    )
    prompt = reply(env_on(target_robot(described(tmp_path, WITHOUT_GAINS, driven_by('<position joint=J kp="500" kv="50"/>')))))
    np.testing.assert_allclose(reply(env_on(late))[1:], prompt[:-1], atol=1e-3)
    env = env_on(late, delay=True)
    env.randomize({"latency": np.array([0.0, 0.1])}, np.random.default_rng(0))
    np.testing.assert_allclose(reply(env)[3:, 1], prompt[:-3, 1], atol=1e-3)


def test_every_domain_parameter_acts_on_it(robot: Robot) -> None:
    env = env_on(robot, PUSH, 3, delay=True)
    base = {
        field: getattr(env.arms.model, field).copy() for field in ("actuator_gainprm", "geom_friction", "body_mass", "geom_pos")
    }
    gain = np.ones((3, 7))
    gain[1] = 1.5
    one = np.array([1.0, 1.5, 1.0])
    env.randomize({"gain": gain, "contact_friction": one, "link_mass": gain, "table_height": one - 1}, np.random.default_rng(0))
    changed, same = (env.arms.batch.get_model(slot) for slot in (1, 2))
    model, names = env.arms.model, robot.names
    for field, values in base.items():
        np.testing.assert_array_equal(getattr(same, field), values)
    servos = [model.actuator(name).id for name in names.servos]
    np.testing.assert_allclose(changed.actuator_gainprm[servos], 1.5 * base["actuator_gainprm"][servos])
    touching = [model.geom(name).id for name in ("table", "box", *names.finger)]
    np.testing.assert_allclose(changed.geom_friction[touching, 0], 1.5 * base["geom_friction"][touching, 0])
    links = [model.joint(name).bodyid[0] for name in names.joints]
    np.testing.assert_allclose(changed.body_mass[links], 1.5 * base["body_mass"][links])
    assert changed.geom("table").pos[2] == pytest.approx(0.5)


def test_it_runs_on_the_hardest_domain(robot: Robot) -> None:
    parameters = sample(find_domain("real-like").parameters, 8, np.random.default_rng(0), JOINTS)
    env = env_on(robot, PUSH, 8, delay=True)
    env.randomize(parameters, np.random.default_rng(1))
    env.reset(np.arange(8), np.zeros(8, dtype=np.int64))
    for action in np.random.default_rng(2).uniform(-1, 1, (10, 8, 7)):
        step = env.step(action)
        assert np.isfinite(step.observation).all() and not step.terminated.any()


def test_the_time_step_is_the_models_own_or_the_longest_below_that_fits(tmp_path: Path) -> None:
    steps = {name: timestep_of(target_robot(ROBOTS / f"{name}.toml")) for name in ("torque", "servo", "meshes")}
    assert steps == {"torque": 0.002, "servo": pytest.approx(0.05 / 13), "meshes": 0.0025}
    robot = target_robot(described(tmp_path, "timestep = 0.001\n" + TORQUE))
    assert env_on(robot).arms.substeps == 50
    assert robot.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 and robot.summary["integrator"] == "rk4"


def test_the_fingerprint_follows_what_matters_and_not_where_it_lies(tmp_path: Path) -> None:
    first = target_robot(ROBOTS / "torque.toml").fingerprint
    assert target_robot(described(tmp_path)).fingerprint == first
    others = [
        (TORQUE.replace("900", "901"), MODEL),
        (TORQUE, MODEL.replace('armature="0.6"', 'armature="0.7"')),
        ("start = [-0.2, -1.2, 0, 1.6, 0, 1.1, 3.1]\n" + TORQUE, MODEL),
    ]
    prints = [target_robot(described(tmp_path, text, model)).fingerprint for text, model in others]
    assert len({first, *prints}) == 4


def test_a_start_of_its_own_and_a_raised_base(tmp_path: Path) -> None:
    start = (-0.2, -1.2, 0.0, 1.6, 0.0, 1.1, 3.1)
    robot = target_robot(described(tmp_path, f"start = {list(start)}\n{TORQUE}\n[base]\npos = [0, 0, 0.1]"))
    env = env_on(robot)
    np.testing.assert_allclose(env.arms.joint_position, [start] * 2)
    expected, _ = gripper_and_axes(SAWYER.model, SAWYER.names, start)
    np.testing.assert_allclose(env.achieved_goal()[0] - [0, 0, 0.1], expected, atol=1e-6)
    (note,) = robot.notes
    assert "10 cm from where the source has it" in note


def test_links_that_overlap_everywhere_do_not_touch_each_other_and_are_noted(tmp_path: Path) -> None:
    model = MODEL.replace('size="0.045 0.02"', 'size="0.15 0.15"')
    (note,) = target_robot(described(tmp_path, TORQUE, model)).notes
    assert "fore2 and hand" in note and "do not touch each other" in note


def test_links_that_overlap_at_the_start_are_noted(tmp_path: Path) -> None:
    folded = "start = [0, -1.2, 0, 3.0, 0, 1.1, 0]\n" + TORQUE
    (note,) = [note for note in load_robot(described(tmp_path, folded, MODEL)).notes if "overlap" in note]
    assert "at the task's start these overlap" in note and "exclude" in note


@pytest.mark.parametrize("task", [REACH, PUSH])
def test_the_source_described_as_another_robot_moves_as_the_source(task: ReachTask | PushTask, tmp_path: Path) -> None:
    text = f"""
        model = "torque.xml"
        timestep = {task.timestep}
        joints = {list(SAWYER.names.joints)}
        finger = ["finger"]
        [gripper]
        body = "finger"
        pos = [0, 0, 0.15]
    """
    robot = target_robot(described(tmp_path, text, SAWYER.path.with_suffix(".xml").read_text(encoding="utf-8")))
    assert robot.notes == () and robot.summary["gripper_from_source_m"] == pytest.approx([0, 0, 0], abs=1e-12)
    twin, source = env_on(robot, task), make_env(task, 2, 1)
    for action in np.random.default_rng(0).uniform(-1, 1, (10, 2, 7)):
        np.testing.assert_allclose(twin.step(action).observation, source.step(action).observation, atol=1e-6)


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit"])
def test_servos_that_would_shake_are_integrated_implicitly(integrator: str, tmp_path: Path) -> None:
    light = MODEL.replace('armature="0.6" damping="1.5"', 'armature="0"').replace("RK4", integrator)
    robot = target_robot(described(tmp_path, TORQUE, light))
    explicit = integrator != "implicit"
    assert robot.summary["integrator"] == ("implicitfast" if explicit else "implicit") and len(robot.notes) == explicit + 1
    env = env_on(robot)
    for action in np.random.default_rng(0).uniform(-1, 1, (20, 2, 7)):
        step = env.step(action)
        assert np.isfinite(step.observation).all() and not step.terminated.any()
    assert np.abs(env.arms.batch.bind("qvel")).max() < 2


def test_a_joint_too_light_for_its_limited_servo_follows_all_the_same(tmp_path: Path) -> None:
    light = MODEL.replace('armature="0.6" damping="1.5" frictionloss="0.2"', 'armature="0"')
    robot = target_robot(described(tmp_path, TORQUE, light))
    (note,) = [note for note in robot.notes if "motor inertia" in note]
    assert "up to 0.078 kg·m²" in note and "hand_roll" in note and "shoulder" not in note, "of k_v h = 0.08"
    env = env_on(robot)
    angles = reply(env)
    assert (np.diff(angles, axis=0) > 0).all(), "at its largest torque too"
    assert np.abs(env.arms.joint_velocity[:, 6]).max() < 2
    assert not any("motor inertia" in note for note in target_robot(ROBOTS / "torque.toml").notes)


REFUSED = [
    # robot file, model, what is said, what is hinted
    (TORQUE.replace("torque.xml", "nothing.xml"), MODEL, "model: no file .*nothing.xml", "relative to the robot file"),
    (TORQUE, "hello", "model: torque.xml cannot be read as MJCF", "XML"),
    (TORQUE, "<mujoco/>", "no joint 'base_yaw'", "none"),
    (TORQUE.replace('"elbow"', '"elbo"'), MODEL, "joints: no joint 'elbo'", "base_yaw, shoulder, upper_roll, elbow"),
    (TORQUE.replace('"elbow", ', ""), MODEL, "gains.kp: expected 6 values.*got 7", "robots.md"),
    (TORQUE.replace('"elbow"', '"wrist"'), MODEL, "joints: names 'wrist' more than once", "robots.md"),
    (
        TORQUE.replace('"elbow", "fore_roll"', '"fore_roll", "elbow"'),
        MODEL,
        "'elbow' does not hang on 'fore_roll'",
        "from the base",
    ),
    (TORQUE, MODEL.replace('name="elbow"', 'name="elbow" type="slide"'), "'elbow' is not a hinge", "turn"),
    (
        TORQUE,
        MODEL.replace('name="elbow"', 'name="elbow" axis="0 0 -1"'),
        "'elbow' turns about .* differ by more than 45",
        "signs",
    ),
    ("[base]\nquat = [0, 0, 0, 1]\n" + TORQUE, MODEL, "'model' is missing", "robots.md"),
    (TORQUE + "\n[base]\nquat = [0, 1, 0, 0]", MODEL, "'base_yaw' turns about", "base.quat"),
    (TORQUE + "\n[base]\npos = [0, 0, 0.5]", MODEL, r"gripper: at the task's start it is at .* 0\.50 m from", "base.pos"),
    (TORQUE.replace('[gripper]\nsite = "mount"', ""), MODEL, "'gripper' is missing", "robots.md"),
    (TORQUE.replace('site = "mount"', ""), MODEL, "either site = .*, or body", "robots.md"),
    (TORQUE.replace('"mount"', '"tip"'), MODEL, "gripper.site: no site 'tip'", "mount"),
    (TORQUE.replace('site = "mount"', 'body = "claw"'), MODEL, "gripper.body: no body 'claw'", "wrist_link, hand"),
    (TORQUE.replace('site = "mount"', 'body = "fore"'), MODEL, "'fore' does not move with 'hand_roll'", "last joint"),
    (
        TORQUE.replace('site = "mount"', 'body = "hand"\npos = [0, 1]'),
        MODEL,
        "gripper.pos: expected three numbers",
        "robots.md",
    ),
    (WITHOUT_GAINS, MODEL, "gains: joint 'base_yaw' has no position servo", "kp and kv"),
    (WITHOUT_GAINS, driven_by(""), "gains: joint 'base_yaw' has no actuator", "kp and kv"),
    (TORQUE.replace("kp = [900", "kp = [-900"), MODEL, "gains: every gain and force must be positive", "robots.md"),
    (TORQUE.replace("kp = [900, ", "kp = ["), MODEL, "gains.kp: expected 7 values", "robots.md"),
    (TORQUE + "\n[finger]\nname = 1", MODEL, "finger", "robots.md"),
    (TORQUE + "\n[arm]\nname = 1", MODEL, "unknown key 'arm'", "model, joints, gripper"),
    (TORQUE.replace("kp =", "ki ="), MODEL, "'gains.kp' is missing|unknown key 'gains.ki'", ""),
    ('finger = ["thumb"]\n' + TORQUE, MODEL, "neither a geom nor a body 'thumb'", "geoms there"),
    ('actuators = ["a", "b", "c", "d", "e", "f", "g"]\n' + TORQUE, MODEL, "no actuator 'a'", "base_yaw_torque"),
    ('finger = ["turret"]\n' + TORQUE, MODEL, "finger: 'turret' does not move with 'hand_roll'", "last joint"),
    ("finger = [1]\n" + TORQUE, MODEL, "finger, entry 1: expected text in quotes, got 1", "robots.md"),
    (TORQUE.replace("kp = [900", "kp = [inf"), MODEL, "gains.kp, entry 1: expected a finite number, got inf", "robots.md"),
    ('gravity_compensation = "no"\n' + TORQUE, MODEL, "gravity_compensation: expected true or false, got 'no'", "robots.md"),
    ("timestep = 1e-6\n" + TORQUE, MODEL, "timestep: expected at least 0.0001, got 1e-06", "robots.md"),
    (TORQUE, MODEL.replace('"0.002"', '"0.00002"'), "timestep: the model's own is 2e-05 s, from 0.0001 to 0.02 s", "0.002"),
    ("timestep = 0.1\n" + TORQUE, MODEL, "timestep: expected at most 0.02, got 0.1", "robots.md"),
    ("joints =", MODEL, "cannot be read", "TOML"),
    (TORQUE.replace("torque.xml", "x" * 5000), MODEL, "model: no file", "relative to the robot file"),
    ("speed_limit = [1, 1, 1, 0, 1, 1, 1]\n" + TORQUE, MODEL, "speed_limit: every speed must be positive", "robots.md"),
    ("acceleration_limit = [1, 1, -1, 1, 1, 1, 1]\n" + TORQUE, MODEL, "every acceleration must be positive", "robots.md"),
    ("acceleration_limit = [1, 1]\n" + TORQUE, MODEL, "acceleration_limit: expected 7 values, one for each joint", "robots.md"),
    (TORQUE + "\n[base]\npos = [1e3, 0, 0]", MODEL, "base: pos must lie within 10 m", "robots.md"),
    *((TORQUE, MODEL.replace(old, new), said, "fix the MJCF file") for old, new, said in (
        ('armature="0.6"', 'armature="nan"', "not finite, or absurd, in dof_armature"),
        ('armature="0.6"', 'armature="-5"', "a negative armature of a joint"),
        ('"-3.0439 3.0439"', '"nan 3"', "not finite, or absurd, in jnt_range"),
        ('timestep="0.002"', 'timestep="nan"', "not finite, or absurd, in timestep"),
        ('timestep="0.002"', 'gravity="0 0 1e30"', "not finite, or absurd, in gravity"),
    )),
    *(
        (TORQUE, MODEL.replace('"0.002"', f'"{own}"'), f"timestep: the model's own is {own} s", "0.002")
        for own in ("0", "-1", "1")
    ),
    *((TORQUE, MODEL.replace("<worldbody>", f"{bomb}<worldbody>", 1), "makes .* of what it holds", "at most") for bomb in (
        '<asset><hfield name="h" nrow="20000" ncol="20000" size="1 1 1 1"/></asset>',
        '<worldbody><replicate count="300"><replicate count="300"><geom size="1"/></replicate></replicate></worldbody>',
        '<worldbody><flexcomp name="f" type="grid" count="400 400 400" radius="1"/></worldbody>',
    )),
    (TORQUE, MODEL.replace("<worldbody>", '<include file="torque.xml"/><worldbody>', 1), "already included", "XML"),
    (TORQUE, MODEL.replace("<worldbody>", '<include file="robot.toml"/><worldbody>', 1), "cannot be read as MJCF", "XML"),
    (TORQUE, MODEL.replace("<worldbody>", '<include file="none.xml"/><worldbody>', 1), "opening file 'none.xml'", "XML"),
    (TORQUE, '<robot name="x"><link name="a"/></robot>', "no joint 'base_yaw'", "none"),
    (WITHOUT_GAINS, driven_by('<position joint=J kp="500" kv="50" delay="1e9" nsample="3"/>'), "1e.09 s late", "fix"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "model", "said", "hinted"), REFUSED)
def test_what_does_not_fit_is_refused_with_a_reason(text: str, model: str, said: str, hinted: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=said) as caught:
        target_robot(described(tmp_path, text, model))
    assert hinted in caught.value.hint and "robot.toml" in caught.value.message and "\n" not in caught.value.message


@pytest.mark.parametrize(
    ("text", "model", "said"),
    [
        ("timestep = 0.003\n" + TORQUE, MODEL, "timestep: the control period of 0.05 s is not a whole number"),
        ("start = [9, 0, 0, 0, 0, 0, 0]\n" + TORQUE, MODEL, "start: joint 'base_yaw' at 9 rad is outside of its range"),
        (TORQUE, MODEL.replace('"-3.0439 3.0439"', '"-1 1"'), "start: joint 'elbow' at 1.6.* outside of its range -1 .. 1"),
        (
            "finger = []\n" + TORQUE.replace('site = "mount"', 'body = "hand"\npos = [0, 0, 0.17]'),
            MODEL,
            "nothing to push with",
        ),
    ],
)
def test_what_does_not_fit_the_task_is_refused_when_it_is_made(text: str, model: str, said: str, tmp_path: Path) -> None:
    robot = target_robot(described(tmp_path, text, model))
    with pytest.raises(UsageError, match=said) as caught:
        make_env(PUSH, 1, robot=robot)
    assert caught.value.hint and "robot.toml" in caught.value.message


def test_a_huge_file_is_not_read(tmp_path: Path) -> None:
    path = described(tmp_path, TORQUE, MODEL + "\n<!--" + "x" * MAX_BYTES + "-->")
    with pytest.raises(UsageError, match=r"torque\.xml has 32 MiB"):
        target_robot(path)


def test_a_servo_that_cannot_be_told_to_stay_at_the_start_is_refused(tmp_path: Path) -> None:
    """The elbow starts at 1.65 rad; what a servo cannot be told is not commanded either."""
    servos = driven_by('<position joint=J kp="500" kv="50" ctrlrange="-4 4"/>')
    elbow = re.compile('("elbow"[^>]*ctrlrange=)"-4 4"')
    robot = target_robot(described(tmp_path, WITHOUT_GAINS, elbow.sub(r'\1"0 1"', servos)))
    with pytest.raises(UsageError, match=r"joint .elbow. starts at 1.65.* rad, and its servo takes 0 .. 1 rad") as caught:
        make_env(REACH, 1, robot=robot)
    assert "ctrlrange" in caught.value.hint and "robot.toml" in caught.value.message
    env = env_on(target_robot(described(tmp_path, WITHOUT_GAINS, elbow.sub(r'\1"1 1.7"', servos))))
    for _ in range(20):
        env.step(np.ones((2, 7)))
    assert env.arms.commanded[:, 3].max() <= 1.7


def test_an_arm_that_hangs_is_noted_with_how_far_and_what_to_do(tmp_path: Path) -> None:
    sagging = "gravity_compensation = false\n" + TORQUE
    (note,) = target_robot(described(tmp_path, sagging)).notes
    found = re.fullmatch(r"at rest the arm hangs (.*) cm off where it is told to be, 'shoulder' by (.*)°: (.*)", note)
    assert found and "`gravity_compensation = true`" in found[3]
    env = env_on(target_robot(described(tmp_path, sagging)), num_envs=1)
    start = env.achieved_goal()[0]
    for _ in range(60):
        env.step(np.zeros((1, 7)))
    assert float(found[1]) == pytest.approx(100 * np.linalg.norm(env.achieved_goal()[0] - start), abs=0.06)
    assert float(found[2]) == pytest.approx(np.degrees(abs(env.arms.joint_position - SAWYER.start("reach"))).max(), abs=0.06)
    assert not target_robot(described(tmp_path)).notes


def test_an_arm_whose_servos_tear_it_apart_is_noted(tmp_path: Path) -> None:
    stiff = re.sub(r"kp = .*", "kp = [1e9, 1e9, 1e9, 1e9, 1e9, 1e9, 1e9]", TORQUE)
    free = MODEL.replace('ctrlrange="-1 1"', "").replace('armature="0.6"', 'armature="0"')
    assert any("comes apart: its gains are too high" in note for note in target_robot(described(tmp_path, stiff, free)).notes)


def test_joint_speeds_are_judged_by_the_robots_own_data_sheet(tmp_path: Path) -> None:
    slow = target_robot(described(tmp_path, "speed_limit = [0.1, 9, 9, 9, 9, 9, 9]\n" + TORQUE))
    usual = target_robot(described(tmp_path))
    found = []
    for robot in (slow, usual):
        env = env_on(robot)
        for _ in range(5):
            env.step(np.eye(7)[[0, 1]])
        found.append(env.violations()[:, 1].tolist())
    assert found == [[True, False], [False, False]]
    assert usual.summary["own_speed_limit"] is False and usual.summary["speed_limit"] == list(SAWYER.speed_limit)
    assert slow.summary["speed_limit"][0] == 0.1 and slow.fingerprint != usual.fingerprint


def test_an_acceleration_limit_is_for_executions_and_leaves_the_robot_the_same(tmp_path: Path) -> None:
    usual = target_robot(described(tmp_path))
    gentle = target_robot(described(tmp_path, "acceleration_limit = [1, 2, 3, 4, 5, 6, 7]\n" + TORQUE))
    assert gentle.acceleration_limit.tolist() == [1, 2, 3, 4, 5, 6, 7] and np.isinf(usual.acceleration_limit).all()
    assert gentle.fingerprint == usual.fingerprint, "skills that were trained on it are still its skills"


def chain_of(*links: tuple[float, float, float]) -> str:
    """An arm as Denavit and Hartenberg write it: each link along the axis, m, across, m, and the turn, degrees."""
    text = "".join(
        f'<body pos="{a} 0 {d}" euler="{turn} 0 0"><joint name="{name}" axis="0 0 1"/><geom size="0.05"/>'
        for name, (a, d, turn) in zip(NAMES, ((0, 0.3, 0), *((a, d, turn) for d, a, turn in links)), strict=True)
    )
    return f'<mujoco><compiler angle="degree"/><worldbody>{text}<site name="mount"/>{"</body>" * 7}</worldbody></mujoco>'


PANDA = chain_of((0, 0, -90), (0.316, 0, 90), (0, 0.0825, 90), (0.384, -0.0825, -90), (0, 0, 90), (0, 0.088, 90))
IIWA = chain_of((0, 0, -90), (0.42, 0, 90), (0, 0, 90), (0.4, 0, -90), (0, 0, -90), (0.126, 0, 90))
PARALLEL = chain_of((0, 0, 90), (0, 0.42, 0), (0, 0.39, 0), (0, 0, 90), (0.1, 0, 90), (0.1, 0, 90))


@pytest.mark.parametrize("arm", [PANDA, IIWA, PARALLEL])
@pytest.mark.parametrize("text", [TORQUE, WITHOUT_GAINS])
def test_another_arm_is_called_one_before_anything_else_is_asked_for(arm: str, text: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"this looks like another arm than the 'sawyer' of the skills: .* where") as caught:
        target_robot(described(tmp_path, text, arm))
    assert "skills are joint motions of one arm and do not carry over" in caught.value.hint and "train" in caught.value.hint


def test_an_arm_of_six_joints_is_another_one(tmp_path: Path) -> None:
    six = TORQUE.replace('"elbow", ', "").replace("kp = [900, ", "kp = [").replace("kv = [90, ", "kv = [")
    with pytest.raises(UsageError, match=r"joints: must name seven.*got 6") as caught:
        target_robot(described(tmp_path, six))
    assert "another arm" in caught.value.hint


def test_neither_signs_nor_zeros_nor_the_base_make_another_arm(tmp_path: Path) -> None:
    """Those get the message that says which joint turns the wrong way: see `REFUSED`."""
    turned = MODEL.replace('name="elbow"', 'name="elbow" axis="0 0 -1"')
    for text, model in ((TORQUE, turned), (TORQUE + "\n[base]\nquat = [0, 1, 0, 0]\npos = [0, 0, 2]", MODEL)):
        with pytest.raises(UsageError, match="turns about"):
            target_robot(described(tmp_path, text, model))


def test_a_missing_robot_file_and_a_task_without_a_robot_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no such file"):
        target_robot(tmp_path / "nothing.toml")
    with pytest.raises(UsageError, match="point task has no robot"):
        make_env(PointTask(), 1, robot=target_robot(ROBOTS / "torque.toml"))


def test_meshes_that_are_all_there_is_to_touch_must_be_there(tmp_path: Path) -> None:
    model = re.sub('<geom (fromto|type="cylinder" size="0.045)[^>]*/>', '<geom type="mesh" mesh="shell"/>', MODEL)
    model = model.replace("<worldbody>", '<asset><mesh name="shell" file="shell.stl"/></asset><worldbody>')
    with pytest.raises(UsageError, match="nothing is left of the arm that can touch") as caught:
        target_robot(described(tmp_path, TORQUE, model))
    assert "1 mesh files are missing: 7 geoms" in caught.value.hint


def tetrahedron(edge: float) -> str:
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in [(0, 0, 0), (edge, 0, 0), (0, edge, 0), (0, 0, edge)])
    return corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_meshes_that_are_there_are_used_from_the_folder_of_the_model(tmp_path: Path) -> None:
    model = MODEL.replace('<geom type="cylinder" size="0.045 0.02"/>', '<geom type="mesh" mesh="shell"/>')
    model = model.replace("<worldbody>", '<asset><mesh name="shell" file="shell.obj"/></asset><worldbody>')
    model = model.replace("<compiler ", '<compiler meshdir="meshes" ')
    prints = []
    for edge in (0.05, 0.06):
        folder = tmp_path / str(edge)
        (folder / "meshes").mkdir(parents=True)
        (folder / "meshes" / "shell.obj").write_text(tetrahedron(edge), encoding="utf-8")
        robot = target_robot(described(folder, TORQUE, model))
        assert robot.model.nmesh == 1 and not robot.notes
        assert np.isfinite(env_on(robot).step(np.ones((2, 7))).observation).all()
        prints.append(robot.fingerprint)
    assert prints[0] != prints[1], "what the file holds counts"


def test_meshes_of_an_attached_model_lie_where_that_model_says(tmp_path: Path) -> None:
    hand = (
        '<mujoco><compiler meshdir="assets"/><asset><mesh name="palm" file="palm.obj"/></asset>'
        '<worldbody><body name="palm"><geom type="mesh" mesh="palm" mass="0.1"/></body></worldbody></mujoco>'
    )
    (tmp_path / "hand" / "assets").mkdir(parents=True)
    (tmp_path / "hand" / "hand.xml").write_text(hand, encoding="utf-8")
    (tmp_path / "hand" / "assets" / "palm.obj").write_text(tetrahedron(0.05), encoding="utf-8")
    model = MODEL.replace("<worldbody>", '<asset><model name="h" file="hand/hand.xml"/></asset><worldbody>')
    model = model.replace('<site name="mount"', '<attach model="h" body="palm" prefix="h_"/><site name="mount"')
    robot = target_robot(described(tmp_path, TORQUE, model))
    assert robot.model.nmesh == 1 and not any("missing" in note for note in robot.notes)


def test_contact_pairs_of_what_is_left_behind_go_along(tmp_path: Path) -> None:
    model = MODEL.replace("<worldbody>", '<worldbody><geom name="floor" type="plane" size="1 1 .1"/>')
    model = model.replace('<geom type="cylinder" size="0.045 0.02"/>', '<geom name="pad" type="cylinder" size="0.045 0.02"/>')
    model = model.replace("<contact>", '<contact><pair geom1="floor" geom2="pad"/>')
    assert target_robot(described(tmp_path, TORQUE, model)).model.npair == 0


@pytest.mark.parametrize("option", ['<flag gravity="disable"/>', None])
def test_a_box_has_its_weight_beside_an_arm_without_gravity(option: str | None, tmp_path: Path) -> None:
    start = '<option timestep="0.002"'
    model = MODEL.replace(start, start + ' gravity="0 0 0"')
    if option:
        model = re.sub("(<option [^>]*)/>", rf"\1>{option}</option>", MODEL)
    robot = target_robot(described(tmp_path, TORQUE.replace("[gripper]", "gravity_compensation = true\n[gripper]"), model))
    assert any("no gravity" in note for note in robot.notes)
    env = env_on(robot, PUSH)
    before = env.arms.object_pose.copy()
    env.arms.batch.bind("qvel")[:, -6] = 0.3
    for _ in range(20):
        step = env.step(np.zeros((2, 7)))
    moved = env.arms.object_pose - before
    assert (moved[:, 2] < -5e-4).all() and (moved[:, 2] > -2e-3).all(), "it lies on the table, and weighs on it"
    assert (np.abs(moved[:, 0]) > 1e-3).all() and (np.abs(moved[:, 0]) < 0.05).all(), "friction has stopped it"
    assert not step.terminated.any() and np.abs(env.arms.object_velocity).max() < 0.01


def test_a_finger_without_a_name_gets_one_that_is_free(tmp_path: Path) -> None:
    both = '<geom type="cylinder" size="0.045 0.02"/><geom name="finger0" size="0.01" fromto="0 0 0 0 0 0.15"/>'
    model = MODEL.replace('<geom type="cylinder" size="0.045 0.02"/>', both)
    robot = target_robot(described(tmp_path, 'finger = ["hand"]\n' + TORQUE, model))
    assert len(set(robot.names.finger)) == 2


def test_an_arm_that_touches_nothing_breaks_no_limit(tmp_path: Path) -> None:
    model = MODEL.replace('<geom type="capsule"/>', '<geom type="capsule" contype="0" conaffinity="0"/>')
    env = env_on(target_robot(described(tmp_path, "finger = []\n" + TORQUE, model)))
    assert not env.violations().any()
