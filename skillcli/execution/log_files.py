"""Read logs of an arm from CSV and NPZ files, which may come from anywhere: docs/identify.md lists columns and keys."""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from skillcli.errors import UsageError
from skillcli.execution.log import MOST_ROWS, USUAL_PERIOD, Log, checked
from skillcli.paths import expanded, read_small
from skillcli.plaintext import line
from skillcli.trajectories import Array

MOST_BYTES = 256 * 1024 * 1024  # of a file, and of its unpacked arrays
MOST_COLUMNS = 1000
MOST_JOINTS = 64
HELP = "docs/identify.md lists what a log holds"
NO_STAMPS = f"no time stamps: a control period of {USUAL_PERIOD:g} s is assumed, `--period` sets another"
AXES = ("x", "y", "z")


def is_log_file(text: str) -> bool:
    """Return whether a text names a log file, and not an artifact."""
    return Path(text).suffix.lower() in (".csv", ".npz")


def read_log(path: Path | str, joints: Sequence[str], period: float | None = None) -> Log:
    """Read a log of an arm whose joints have these names.

    Args:
        path: of a .csv or .npz file.
        joints: names in the order of the robot file.
        period: of a control step, s, where the log has no stamps.

    Raises:
        UsageError: it cannot be read, or is no log of this arm.
    """
    file = expanded(path)
    what = f"log {line(str(path))}"
    try:
        raw = read_small(file, MOST_BYTES)
    except (OSError, ValueError) as error:
        said = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise UsageError(f"{what} cannot be read: {line(str(said))}", HELP) from None
    reader = _csv_log if file.suffix.lower() == ".csv" else _npz_log
    return checked(reader(raw, tuple(joints), period or USUAL_PERIOD, what), what)


def _csv_log(raw: bytes, joints: tuple[str, ...], period: float, what: str) -> Log:
    header, table = _table(raw, what)
    index = {name: number for number, name in enumerate(header)}

    def columns(kind: str) -> Array | None:
        own = [name.removeprefix(f"{kind}_") for name in header if name.startswith(f"{kind}_")]
        if not own:
            return None
        if sorted(own) != sorted(joints):
            raise _wrong_joints(what, f"columns {kind}_…", own, joints)
        return table[:, [index[f"{kind}_{joint}"] for joint in joints]]

    position, target, increment = columns("position"), columns("target"), columns("increment")
    if position is None or (target is None) == (increment is None):
        raise UsageError(
            f"{what}: expected the columns position_JOINT, and target_JOINT or increment_JOINT, got {_listed(header)}", HELP
        )
    gripper = [index[f"gripper_{axis}"] for axis in AXES if f"gripper_{axis}" in index]
    if gripper and len(gripper) != len(AXES):
        raise UsageError(f"{what}: expected gripper_x, gripper_y and gripper_z, or none of them", HELP)
    stamped = "time" in index
    stamps = table[:, index["time"]] if stamped else period * np.arange(len(table))
    episode = table[:, index["episode"]] if "episode" in index else np.zeros(len(table))
    changes = np.flatnonzero(np.diff(episode)) + 1
    return Log(
        names=joints,
        stamps=stamps,
        position=position,
        sent=target if target is not None else increment,  # type: ignore[arg-type]
        increments=target is None,
        starts=(0, *(int(row) for row in changes)),
        velocity=columns("velocity"),
        gripper_position=table[:, gripper] if gripper else None,
        notes=() if stamped else (NO_STAMPS,),
    )


def _table(raw: bytes, what: str) -> tuple[list[str], Array]:
    """Return the header and the numbers of a CSV file, (T, c)."""
    try:
        rows = csv.reader(io.StringIO(raw.decode("utf-8-sig"), newline=""), strict=True)
        header = [name.strip() for name in next(rows, [])]
        if len(header) > MOST_COLUMNS:
            raise UsageError(f"{what} has {len(header)} columns, at most {MOST_COLUMNS} are read", HELP)
        if len(set(header)) != len(header):
            raise UsageError(f"{what}: two columns have one name, got {_listed(header)}", "name every column once")
        numbers: list[list[float]] = []
        for row in rows:
            if not row:
                continue
            if len(numbers) == MOST_ROWS:
                raise UsageError(f"{what} has more than {MOST_ROWS} rows", "cut it into several logs")
            if len(row) != len(header):
                raise UsageError(
                    f"{what}: row {len(numbers) + 1} has {len(row)} values, expected {len(header)}, one for each column", HELP
                )
            numbers.append([float(text) for text in row])
    except UnicodeDecodeError:
        raise UsageError(f"{what} is no UTF-8 text", "a CSV file is text; save it as UTF-8") from None
    except ValueError:
        raise UsageError(f"{what}: row {len(numbers) + 1} holds something that is not a number", HELP) from None
    except csv.Error as error:
        raise UsageError(f"{what} is not CSV: {line(str(error))}", HELP) from None
    return header, np.array(numbers, dtype=float).reshape(len(numbers), len(header))


def _npz_log(raw: bytes, joints: tuple[str, ...], period: float, what: str) -> Log:
    arrays = _arrays(raw, what)
    if "joint_position" not in arrays or ("target" in arrays) == ("action" in arrays):
        raise UsageError(f"{what}: expected the arrays joint_position, and target or action, got {_listed(list(arrays))}", HELP)
    angles = arrays["joint_position"]
    if angles.ndim not in (2, 3):
        raise UsageError(f"{what}: joint_position has the shape {angles.shape}, expected (T, J) or (E, T, J)", HELP)
    episodes, rows, count = angles.shape if angles.ndim == 3 else (1, *angles.shape)
    order = _order(arrays.get("joint_names"), count, joints, what)
    lengths = _lengths(arrays.get("length"), episodes, rows, what)
    kept = np.concatenate([first * rows + np.arange(length) for first, length in enumerate(lengths)])

    def of(name: str, width: int) -> Array | None:
        values = arrays.get(name)
        if values is None:
            return None
        wanted = angles.shape[:-1] + ((width,) if width else ())
        if values.dtype.kind not in "fiu" or values.shape != wanted:
            raise UsageError(f"{what}: {name} has the shape {values.shape}, expected {wanted} numbers", HELP)
        flat: Array = values.astype(float).reshape(episodes * rows, -1)[kept]
        return flat if width else flat.ravel()

    def of_joints(name: str) -> Array | None:
        values = of(name, count)
        return None if values is None else values[:, order]

    position, stamps = of_joints("joint_position"), of("time", 0)
    target, action = of_joints("target"), of_joints("action")
    assert position is not None
    return Log(
        names=joints,
        stamps=period * np.concatenate([np.arange(length) for length in lengths]) if stamps is None else stamps,
        position=position,
        sent=target if target is not None else action,  # type: ignore[arg-type]
        increments=target is None,
        starts=tuple(int(first) for first in np.cumsum([0, *lengths[:-1]])),
        velocity=of_joints("joint_velocity"),
        gripper_position=of("gripper_position", 3),
        notes=() if stamps is not None else (NO_STAMPS,),
    )


def _arrays(raw: bytes, what: str) -> dict[str, Array]:
    """Read the arrays of an NPZ file; their headers are compared with their sizes before anything is unpacked."""
    found: dict[str, Array] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > MOST_BYTES or len(members) > MOST_COLUMNS:
                raise UsageError(f"{what} holds more than {MOST_BYTES // 2**20} MB", "cut it into several logs")
            for member in members:
                with archive.open(member) as file:
                    found[member.filename.removesuffix(".npy")] = _array(file.read(), what, member.filename)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, OSError, EOFError, ValueError) as error:
        raise UsageError(f"{what} is not an NPZ file: {line(str(error))[:200]}", HELP) from None
    return found


def _array(content: bytes, what: str, name: str) -> Array:
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    if dtype.hasobject or dtype.kind not in "fiuU" or dtype.itemsize > 4096:
        raise UsageError(f"{what}: {line(name)} is not an array of numbers or names, got {dtype}", HELP)
    if int(np.prod([*shape, dtype.itemsize], dtype=object)) != len(content) - file.tell():
        raise UsageError(f"{what}: {line(name)} does not hold what its header says", "the file is damaged; copy it again")
    file.seek(0)
    values: Array = np.load(file, allow_pickle=False)
    return values


def _order(names: Array | None, count: int, joints: tuple[str, ...], what: str) -> list[int]:
    """Return the column of each joint of the robot file."""
    if names is None:
        if count != len(joints):
            raise UsageError(f"{what} has {count} joints, the robot file {len(joints)}", "give the robot file of this arm")
        return list(range(count))
    own = [str(name) for name in names.ravel()[:MOST_JOINTS]]
    if len(own) != count or sorted(own) != sorted(joints):
        raise _wrong_joints(what, "joint_names", own, joints)
    return [own.index(joint) for joint in joints]


def _lengths(given: Array | None, episodes: int, rows: int, what: str) -> list[int]:
    if given is None:
        return [rows] * episodes
    if given.shape != (episodes,) or given.dtype.kind not in "iu" or (given < 0).any() or (given > rows).any():
        raise UsageError(f"{what}: length must hold the rows of each of the {episodes} episodes, 0 to {rows}", HELP)
    return [int(length) for length in given]


def _wrong_joints(what: str, where: str, got: Sequence[str], wanted: Sequence[str]) -> UsageError:
    return UsageError(
        f"{what}: {where} are not the joints of the robot file; expected {_listed(wanted)}; got {_listed(got)}",
        "name them as the robot file does, in any order",
    )


def _listed(names: Sequence[str]) -> str:
    """List names from a file, in one line and not too many."""
    shown = ", ".join(line(name)[:40] for name in names[:20])
    return (shown or "none") + (" …" if len(names) > 20 else "")
