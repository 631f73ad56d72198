"""`skill execute` as a user meets it, on the reference artifacts and a simulated arm in its own process."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import made, skill
from rich.table import Table

from skillcli.cli.tables import table_of
from skillcli.errors import SkillError
from skillcli.evaluation.consistency import check_meaning
from skillcli.execution.driver import DriverError
from skillcli.execution.drivers.simulation import Settings, SimulationDriver
from skillcli.execution.execute import Asked
from skillcli.execution.filter import LIMITED
from skillcli.kinds import EXECUTION
from skillcli.recipe import load_recipe
from skillcli.robots.robot import load_robot
from skillcli.stages.execution import Via, execute
from skillcli.store import Artifact, ArtifactId, Store
from skillcli.store.results import complaints
from skillcli.tasks.world import World

pytestmark = pytest.mark.slow  # each starts a process and runs in real time

SHIPPED = Path(__file__).parents[2] / "artifacts"
PLAN = "reference-reach/compose-v1"
PERIOD = 0.05
TRIES = 4  # a machine that is busy with other tests stops an arm earlier, or lets it wait


@pytest.fixture
def store(tmp_path: Path) -> Path:
    for name in ("reference-reach", "reference-push-robust", "reference-point"):
        shutil.copytree(SHIPPED / name, tmp_path / "artifacts" / name)
    return tmp_path / "artifacts"


def settings(folder: Path, text: str) -> Path:
    path = folder / "driver.toml"
    path.write_text(text, encoding="utf-8")
    return path


def executed(store: Path, *words: str | Path, conditions: str = "") -> tuple[dict[str, Any], Artifact]:
    """Execute on a machine that may be busy with other tests."""
    patient = settings(store.parent, f"patience = 2.0\n{conditions}")
    told = made("--store", store, "execute", *words, "--driver-settings", patient, "--yes")
    return told, Store(store).read(ArtifactId.parse(told["id"]))


@pytest.mark.parametrize("domain", ["nominal", "mild"])
def test_it_ends_where_transfer_eval_ends_on_the_same_domain(store: Path, domain: str) -> None:
    told, artifact = executed(store, PLAN, "--domain", domain, "--episodes", "4")
    assert told["driver"] == "simulation" and told["episodes"] == told["successes"] == 4 and told["stopped"] is None
    assert set(told["deadlines"]) == {"steps", "missed", "p99_ms"} and told["deadlines"]["steps"] == 4 * 49
    transfer = made("--store", store, "transfer-eval", PLAN, "--domain", domain, "--episodes", "8")["domains"][0]
    assert told["final_distance_m"]["median"] == pytest.approx(transfer["final_distance_m"]["median"], abs=0.005)
    assert told["filtered_steps"] == 0
    check_meaning(artifact)
    spec = EXECUTION
    assert spec.results_of(artifact).json() == artifact.results and spec.measured_of(artifact).json() == artifact.measured
    assert not list(complaints("execution", artifact.results, artifact.measured))
    sent = artifact.arrays["execution/commanded"]
    began = artifact.arrays["trajectories/joint_position"][:, :1]
    assert began + np.cumsum(artifact.arrays["trajectories/action"], axis=1) == pytest.approx(sent, abs=1e-5)


def test_a_box_is_seen_and_pushed(store: Path) -> None:
    told, artifact = executed(store, "reference-push-robust/compose-v1", "--episodes", "1")
    assert told["successes"] == 1 and artifact.arrays["trajectories/object_pose"].shape[2] == 7
    planned = Store(store).read(ArtifactId.parse("reference-push-robust/compose-v1"))
    assert told["final_distance_m"]["median"] == pytest.approx(planned.results["final_distance_m"], abs=0.01)


def test_a_plan_is_made_again_on_the_way_while_the_arm_holds(store: Path) -> None:
    told, artifact = executed(store, PLAN, "--replan", "--domain", "real-like")
    assert told["replanned"] and told["stopped"] is None and told["successes"] == 1
    assert artifact.measured["seconds_per_plan"] > 0
    steps = slice(artifact.arrays["trajectories/length"][0])
    holds = ~artifact.arrays["trajectories/latent"][0, steps].any(axis=1)
    action = artifact.arrays["trajectories/action"][0, steps]
    assert holds[0] and not holds.all(), "the first plan is waited for too"
    assert (artifact.arrays["trajectories/skill"][0, steps][holds] == -1).all()
    assert not action[holds].any() and action[~holds].any()
    check_meaning(artifact)


def test_a_dry_run_is_not_planned_again(store: Path) -> None:
    result = skill("--store", store, "execute", "reference-reach/compose-v1", "--replan", "--dry-run", "--yes")
    assert result.code == 2 and "a dry run sends nothing" in result.err


def test_bare_skills_hold_no_plan_to_make_again(store: Path) -> None:
    result = skill("--store", store, "execute", "reference-reach/embed-means-v1", "--replan", "--yes")
    assert result.code == 2 and "holds no plan" in result.err


def test_figure_recording_table_and_verification(store: Path, tmp_path: Path) -> None:
    told, artifact = executed(store, PLAN, "--speed", "2")
    drawn = made("--store", store, "viz", told["id"], "--png", tmp_path / "a.png", "-o", tmp_path / "a.rrd")
    assert (tmp_path / "a.png").stat().st_size > 10_000 and any("planned" in entity for entity in drawn["entities"])
    assert made("--store", store, "verify", told["id"])["ok"]
    table = table_of(artifact).renderables[1]
    assert isinstance(table, Table)
    assert [next(iter(column.cells)) for column in table.columns][:2] == ["sawyer, simulated: nominal", "1/1"]


FAULTS = {
    "stall": "stale_reading",
    "freeze": "frozen_reading",
    "gap": "stale_reading",
    "nan": "not_finite",
    "swap": "joint_names",
    "drop": "driver_lost",
    "clock": "clock_jump",
    "back": "clock_jump",
    "kill": "driver_lost",
}


@pytest.mark.real_time  # what it judges is a matter of milliseconds
@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_ends_in_a_hold_a_stored_execution_and_a_clear_line(store: Path, tmp_path: Path, fault: str) -> None:
    at = 0.52
    file = settings(tmp_path, f'faults = [{{ kind = "{fault}", at = {at}, seconds = 0.2 }}]')
    late = 0.03  # s, a target is on its way
    begins = 0.55 if fault == "drop" else at  # the next command after it is lost
    for _ in range(TRIES):
        result = skill("--json", "--store", store, "execute", PLAN, "--driver-settings", file, "--episodes", "2", "--yes")
        told = json.loads(result.out)
        if begins <= told["stopped"]["seconds"] <= begins + PERIOD + late:
            break
    assert result.code == 1 and told["stopped"]["reason"] == FAULTS[fault] and told["episodes"] == 1
    assert f"error: stopped, {FAULTS[fault]}: " in result.err and "the arm holds" in result.err
    assert begins <= told["stopped"]["seconds"] <= begins + PERIOD + late
    artifact = Store(store).read(ArtifactId.parse(told["id"]))
    keeps_its_limits(artifact)
    assert not artifact.arrays["trajectories/success"].any()
    assert Store(store).verify(artifact.id, check_meaning) == []


def keeps_its_limits(artifact: Artifact) -> None:
    """No target that was sent breaks range, speed or acceleration."""
    world = World.of(load_recipe("reach"))
    sent = artifact.arrays["execution/commanded"][0]
    first = artifact.arrays["trajectories/joint_position"][0, 0]
    steps = np.diff(np.concatenate([first[None], sent]), axis=0)
    assert (np.abs(steps) <= world.robot.speed_limit * PERIOD + 1e-6).all()
    assert (np.abs(np.diff(steps, axis=0)) <= 0.08 + 1e-6).all()
    ranges = np.array([world.robot.model.joint(name).range for name in world.robot.names.joints])
    assert (sent >= ranges[:, 0]).all() and (sent <= ranges[:, 1]).all()


def test_messages_that_take_a_while_are_lived_with(store: Path) -> None:
    told, _ = executed(store, PLAN, conditions="latency = 0.005\njitter = 0.003\n")
    assert told["stopped"] is None and told["successes"] == 1


def test_a_dry_run_sends_nothing_and_a_slow_one_takes_its_time(store: Path) -> None:
    told, artifact = executed(store, PLAN, "--dry-run", "--speed", "2")
    assert told["dry_run"] and told["successes"] == 0
    still = artifact.arrays["trajectories/joint_position"][0]
    assert np.abs(still - still[0]).max() < 1e-3
    told, artifact = executed(store, PLAN, "--max-speed", "0.5", "--speed", "2")
    assert told["successes"] == 1 and artifact.arrays["trajectories/length"][0] == 98
    assert np.abs(np.diff(artifact.arrays["execution/commanded"][0], axis=0)).max() <= 0.02 + 1e-6


def test_an_arm_elsewhere_is_refused_and_moved_home_on_request(store: Path, tmp_path: Path) -> None:
    far = tmp_path / "far.toml"
    far.write_text('name = "far"\n[parameters]\nstart_offset = { uniform = [0.3, 0.3] }\n', encoding="utf-8")
    refused = skill("--store", store, "execute", PLAN, "--domain", far, "--yes")
    assert refused.code == 1 and "the arm is not at the start: right_j" in refused.err and "--home" in refused.err
    told, artifact = executed(store, PLAN, "--domain", far, "--home", "--speed", "2")
    assert told["successes"] == 1
    start = np.array(World.of(load_recipe("reach")).robot.home)
    assert np.abs(artifact.arrays["trajectories/joint_position"][0, 0] - start).max() < 0.05


def test_before_it_moves_somebody_has_to_agree(store: Path) -> None:
    result = skill("--json", "--store", store, "execute", PLAN)
    assert result.code == 2 and "somebody has to agree" in result.json["error"]["message"]
    with pytest.raises(SkillError, match="not confirmed"):
        shown: list[str] = []
        execute(Store(store), ArtifactId.parse(PLAN), Via(), Asked(), lambda lines: bool(shown.extend(lines)), "test")
    assert "in our simulation the plan keeps every limit" in " ".join(shown)


class Swapped(SimulationDriver):
    """A simulated arm whose joints are told in another order."""

    def read(self) -> Any:
        state = super().read()
        return state.__class__((*state.names[1:], state.names[0]), np.roll(state.position, -1), state.velocity, state.stamp)


def test_joints_in_another_order_are_refused_with_both_orders(store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def opened(_name: str, given: Mapping[str, object], robot: Any) -> SimulationDriver:
        return Swapped(Settings.model_validate(dict(given)), robot)

    monkeypatch.setattr("skillcli.stages.execution.open_driver", opened)
    with pytest.raises(DriverError) as caught:
        execute(Store(store), ArtifactId.parse(PLAN), Via(), Asked(), lambda _: True, "test")
    names = [f"right_j{joint}" for joint in range(7)]
    assert f"expected {', '.join(names)}; got {', '.join([*names[1:], names[0]])}" in caught.value.message
    assert not [one for one in Store(store).ids() if one.stage == "execution"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_holds_the_arm_and_keeps_what_was_executed(store: Path, number: signal.Signals) -> None:
    command = [sys.executable, "-c", "from skillcli.cli.main import main; main()", "--store", str(store), "execute", PLAN]
    patient = settings(store.parent, "patience = 2.0")
    process = subprocess.Popen(
        [*command, "--episodes", "50", "--yes", "--driver-settings", str(patient)],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ},
    )
    assert process.stderr is not None
    for line in process.stderr:
        if line.startswith("Ctrl-C stops"):
            break
    time.sleep(4)  # the first episode takes half of it
    process.send_signal(number)
    _, told = process.communicate(timeout=30)
    assert process.returncode == 130 and "stopped: the arm holds; what was executed is reference-reach/execution-v1" in told
    results = EXECUTION.results_of(Store(store).read(ArtifactId.parse("reference-reach/execution-v1")))
    assert results.stopped is not None and results.stopped.reason == "interrupted" and results.episodes >= 2
    assert results.successes == results.episodes - 1


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--driver", "nobody"), "no driver 'nobody'"),
        (("--driver", "franka", "--domain", "mild"), "--domain: the arm of --driver franka is real"),
        (("--domain", "nowhere"), "no domain 'nowhere'"),
        (("--driver-settings", "missing.toml"), "cannot be read"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_line(store: Path, words: tuple[str, ...], told: str) -> None:
    result = skill("--store", store, "execute", PLAN, *words, "--yes")
    assert result.code == 2 and told in result.err and "Traceback" not in result.err


def test_a_task_without_an_arm_is_refused(store: Path) -> None:
    result = skill("--store", store, "execute", "reference-point/compose-v1", "--yes")
    assert result.code == 2 and "the point task has no arm" in result.err


def test_wrong_settings_are_named(store: Path, tmp_path: Path) -> None:
    for text, told in (("latnecy = 1", "latnecy"), ('speed = "fast"', "speed"), ("faults = [{ kind = 'rust' }]", "kind")):
        result = skill("--store", store, "execute", PLAN, "--driver-settings", settings(tmp_path, text), "--yes")
        assert result.code == 2 and told in result.err, result.err


def test_the_columns_of_what_was_limited_are_the_filters(store: Path) -> None:
    _, artifact = executed(store, PLAN, "--speed", "4")
    assert artifact.arrays["execution/limited"].shape[2] == len(LIMITED)
    assert load_robot("sawyer").fingerprint == artifact.results["robot"]["fingerprint"]
