"""Log files: what is read from CSV and NPZ, and that whatever is broken is refused in one line."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skillcli.errors import UsageError
from skillcli.execution.log import Log
from skillcli.execution.log_files import read_log
from skillcli.trajectories import Array

JOINTS = ("shoulder", "elbow")
ROWS = 30
ANGLES = np.stack([np.arange(ROWS) / 100, np.arange(ROWS) / 50], axis=1)


def csv_text(columns: dict[str, Any]) -> str:
    table = np.column_stack([np.broadcast_to(values, ROWS) for values in columns.values()])
    return "\n".join([",".join(columns), *(",".join(repr(float(x)) for x in row) for row in table)]) + "\n"


COLUMNS: dict[str, Any] = {
    "time": np.arange(ROWS) * 0.1, "position_elbow": ANGLES[:, 1], "position_shoulder": ANGLES[:, 0],
    "target_shoulder": ANGLES[:, 0] + 1, "target_elbow": ANGLES[:, 1] + 1,
}  # fmt: skip


def from_csv(folder: Path, text: str | bytes, period: float | None = None) -> Log:
    path = folder / "log.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_log(path, JOINTS, period)


def from_npz(folder: Path, arrays: dict[str, Any], period: float | None = None) -> Log:
    path = folder / "log.npz"
    np.savez(path, **arrays)
    return read_log(path, JOINTS, period)


def test_csv_columns_are_found_by_name_in_any_order(tmp_path: Path) -> None:
    log = from_csv(tmp_path, csv_text(COLUMNS))
    np.testing.assert_array_equal(log.position, ANGLES)
    np.testing.assert_array_equal(log.sent, ANGLES + 1)
    assert log.names == JOINTS and log.period == 0.1 and not log.increments and log.notes == ()


def test_a_csv_file_may_hold_increments_speeds_episodes_and_the_gripper_and_no_time(tmp_path: Path) -> None:
    columns = {
        "episode": np.arange(ROWS) // 15, "position_shoulder": ANGLES[:, 0], "position_elbow": ANGLES[:, 1],
        "increment_shoulder": 0.01, "increment_elbow": 0.02, "velocity_shoulder": 1, "velocity_elbow": 2,
        "gripper_x": 0.5, "gripper_y": 0.6, "gripper_z": 0.7,
    }  # fmt: skip
    log = from_csv(tmp_path, csv_text(columns), 0.02)
    assert log.increments and log.starts == (0, 15) and log.period == 0.02 and "no time stamps" in log.notes[0]
    assert log.sent[3].tolist() == [0.01, 0.02] and log.speed[3].tolist() == [1, 2]
    assert log.gripper_position is not None and log.gripper_position[9].tolist() == [0.5, 0.6, 0.7]


def test_npz_arrays_hold_one_episode_or_several_and_joints_in_any_order(tmp_path: Path) -> None:
    one = from_npz(tmp_path, {"joint_position": ANGLES, "target": ANGLES, "time": np.arange(ROWS) * 0.1})
    assert one.starts == (0,) and one.period == 0.1
    both = np.stack([ANGLES, ANGLES + 1])
    arrays = {"joint_position": both, "action": both / 100, "gripper_position": np.zeros((2, ROWS, 3))}
    several = from_npz(tmp_path, {**arrays, "joint_names": ["elbow", "shoulder"], "length": [30, 20]}, 0.04)
    assert several.starts == (0, 30) and len(several.stamps) == 50 and several.increments and several.period == 0.04
    np.testing.assert_allclose(several.position[31], ANGLES[1, ::-1] + 1)


GOOD = {"joint_position": ANGLES, "target": ANGLES}


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"target": ANGLES}, "expected the arrays joint_position, and target or action, got target"),
        ({"joint_position": ANGLES}, "expected the arrays joint_position, and target or action, got joint_position"),
        ({**GOOD, "action": ANGLES}, "expected the arrays joint_position, and target or action"),
        ({"joint_position": ANGLES[:, 0], "target": ANGLES}, r"joint_position has the shape \(30,\), expected \(T, J\)"),
        ({"joint_position": ANGLES, "target": ANGLES[1:]}, r"target has the shape \(29, 2\), expected \(30, 2\) numbers"),
        ({**GOOD, "time": ANGLES}, r"time has the shape \(30, 2\), expected \(30,\) numbers"),
        ({"joint_position": ANGLES[:, :1], "target": ANGLES[:, :1]}, "has 1 joints, the robot file 2"),
        ({**GOOD, "joint_names": ["elbow", "knee"]}, "expected shoulder, elbow; got elbow, knee"),
        ({**GOOD, "joint_names": ["elbow", "[red]kn\x1bee"]}, r"got elbow, \[red\]kn\\x1bee"),
        ({**GOOD, "length": [31]}, "length must hold the rows of each of the 1 episodes, 0 to 30"),
        ({**GOOD, "joint_position": ANGLES * np.nan}, "position is not a finite number in row 1"),
        ({**GOOD, "joint_position": ANGLES.astype(complex)}, "joint_position.npy is not an array of numbers or names"),
        ({**GOOD, "notes": np.array(["a", {}], dtype=object)}, "notes.npy is not an array of numbers or names"),
    ],
)
def test_arrays_that_are_no_log_are_refused(tmp_path: Path, arrays: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said) as refused:
        from_npz(tmp_path, arrays)
    assert "\n" not in refused.value.message


def npz(folder: Path, members: dict[str, bytes]) -> Path:
    path = folder / "log.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def npy(array: Array) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def test_files_that_are_damaged_or_made_to_do_harm_are_refused(tmp_path: Path) -> None:
    huge = npy(ANGLES).replace(b"(30, 2)", b"(9999999999, 2)")
    cases = {"joint_position.npy does not hold what its header says": huge, "is not an NPZ file": b"no array"}
    for said, content in cases.items():
        with pytest.raises(UsageError, match=said):
            read_log(npz(tmp_path, {"joint_position.npy": content}), JOINTS)
    bomb = npz(tmp_path, {"joint_position.npy": bytes(300 * 2**20)})
    with pytest.raises(UsageError, match="holds more than 256 MB"):
        read_log(bomb, JOINTS)
    for content in (b"", b"PK\x03\x04 cut off", b"\x93NUMPY"):
        (tmp_path / "log.npz").write_bytes(content)
        with pytest.raises(UsageError, match="is not an NPZ file"):
            read_log(tmp_path / "log.npz", JOINTS)


HEADER = "time,position_shoulder,position_elbow,target_shoulder,target_elbow\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "expected the columns position_JOINT, and target_JOINT or increment_JOINT, got none"),
        ("time,angle\n0,1\n", "got time, angle"),
        ("position_shoulder,position_knee\n", "expected shoulder, elbow; got shoulder, knee"),
        (HEADER + "0,1,2,3\n", "row 1 has 4 values, expected 5"),
        (HEADER + "0,1,2,3,four\n", "row 1 holds something that is not a number"),
        (HEADER + 25 * "0,1,2,3,nan\n", "sent is not a finite number in row 1"),
        (HEADER.replace("target_elbow", "time"), "two columns have one name"),
        (HEADER + '0,1,2,3,"4\n', "is not CSV"),
        (HEADER + "0,1,2,3,4\n", "has 1 rows, expected at least 20"),
        (b"\xff\xfe" + HEADER.encode(), "is no UTF-8 text"),
        (HEADER.replace("time", "gripper_x"), "expected gripper_x, gripper_y and gripper_z, or none"),
        (",".join(f"c{k}" for k in range(2000)), "has 2000 columns, at most 1000"),
    ],
)
def test_csv_text_that_is_no_log_is_refused(tmp_path: Path, text: str | bytes, said: str) -> None:
    with pytest.raises(UsageError, match=said) as refused:
        from_csv(tmp_path, text)
    assert "\n" not in refused.value.message


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "none.csv", tmp_path, Path("/dev/zero")):
        with pytest.raises(UsageError, match="cannot be read"):
            read_log(path, JOINTS)
