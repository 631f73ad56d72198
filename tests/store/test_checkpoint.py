from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from skillcli.errors import StoreError
from skillcli.store import Store, load_checkpoint, remove_checkpoint, save_checkpoint
from skillcli.store.container import Contents, pack, text_array
from skillcli.store.provenance import package_versions

ARRAYS: dict[str, Any] = {
    "weights/policy/0": np.eye(3, dtype=np.float32),
    "generator/torch": np.arange(256, dtype=np.uint8),
}


@pytest.fixture
def path(store: Store) -> Path:
    return store.checkpoint_path("run", "pretrain", "abcdef" * 10)


def test_training_goes_on_exactly_where_it_was(store: Store, path: Path) -> None:
    state = {
        "iteration": 7,
        "lr": 0.1 + 0.2,
        "generator": np.random.default_rng(3).bit_generator.state,
    }
    save_checkpoint(path, ARRAYS, state)
    arrays, loaded = load_checkpoint(path)
    assert loaded == state
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(arrays[name], array)
    assert path.name == ".checkpoint-pretrain-abcdefabcdef.h5"
    assert store.ids() == []


def test_a_failed_save_leaves_the_last_one(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_checkpoint(path, ARRAYS, {"iteration": 1})

    def fail(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", fail)
        with pytest.raises(StoreError, match="No space left"):
            save_checkpoint(path, ARRAYS, {"iteration": 2})
    assert load_checkpoint(path)[1] == {"iteration": 1}
    save_checkpoint(path, ARRAYS, {"iteration": 3})
    assert load_checkpoint(path)[1] == {"iteration": 3}
    assert list(path.parent.iterdir()) == [path]


def test_a_damaged_or_missing_checkpoint_is_refused(path: Path) -> None:
    with pytest.raises(StoreError, match="No such file"):
        load_checkpoint(path)
    save_checkpoint(path, ARRAYS, {})
    data = bytearray(path.read_bytes())
    data[-100] ^= 4
    path.write_bytes(data)
    with pytest.raises(StoreError, match="bytes have changed"):
        load_checkpoint(path)
    remove_checkpoint(path)
    remove_checkpoint(path)
    assert not path.exists()


@pytest.mark.parametrize("state", [{"a": {1, 2}}, {"a": float("inf")}, {"a": float("nan")}])
def test_a_state_without_json_form_is_refused(path: Path, state: dict[str, Any]) -> None:
    with pytest.raises(StoreError, match="cannot be stored as JSON"):
        save_checkpoint(path, ARRAYS, state)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (None, "record/state"),
        ("[1]", "not a JSON object"),
        ('{"a": 1, "a": 2}', "'a' more than once"),
        ('{"a": NaN}', "NaN is not JSON"),
        ("[" * 900 + "]" * 900, "nested more than 32 deep"),
        ("{", "cannot read"),
    ],
)
def test_a_state_that_is_not_ours_is_refused_in_one_line(path: Path, text: str | None, told: str) -> None:
    state = {} if text is None else {"record/state": text_array(text)}
    header = {"kind": "checkpoint", "schema_version": 1, "packages": package_versions()}
    path.parent.mkdir(parents=True)
    path.write_bytes(
        pack(header, Contents({}, {**ARRAYS, **state}), lambda _, ndim: (",".join(f"axis{i}" for i in range(ndim)), ""))
    )
    with pytest.raises(StoreError, match=told) as caught:
        load_checkpoint(path)
    assert "\n" not in caught.value.message


@pytest.mark.parametrize("moment", ["fsync", "replace"])
def test_a_second_ctrl_c_while_saving_leaves_the_last_one(path: Path, monkeypatch: pytest.MonkeyPatch, moment: str) -> None:
    save_checkpoint(path, ARRAYS, {"iteration": 1})

    def pressed(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(os, moment, pressed)
        with pytest.raises(KeyboardInterrupt):
            save_checkpoint(path, ARRAYS, {"iteration": 2})
    assert load_checkpoint(path)[1] == {"iteration": 1}
    assert list(path.parent.iterdir()) == [path]


def test_a_checkpoint_of_other_packages_is_refused(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("skillcli.store.checkpoint.package_versions", lambda: {"python": "3", "mujoco": "3.9"})
        save_checkpoint(path, ARRAYS, {})
    with pytest.raises(StoreError, match=r"made with .*mujoco 3\.9") as caught:
        load_checkpoint(path)
    assert "without --resume" in caught.value.hint
