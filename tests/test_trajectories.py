import numpy as np
import pytest

from skillcli.trajectories import Trajectories


def recording(episodes: int, **changes: object) -> Trajectories:
    rng = np.random.default_rng(episodes)
    e, t = episodes, 4
    fields = {
        "time": np.arange(t + 1) * 0.05, "latent": rng.normal(size=(e, t, 2)), "skill": np.full((e, t), -1),
        "action": rng.normal(size=(e, t, 7)), "reward": rng.normal(size=(e, t)), "target": rng.normal(size=(e, 3)),
        "success": rng.random(e) < 0.5, "length": np.full(e, t), "gripper_position": rng.normal(size=(e, t + 1, 3)),
    }  # fmt: skip
    return Trajectories(**{**fields, **changes})  # type: ignore[arg-type]


def test_joining_and_selecting_are_inverse_and_share_one_clock() -> None:
    first, second = recording(2), recording(3)
    joined = Trajectories.join([first, second])
    assert joined.episodes == 5
    for name, array in joined.select([2, 3, 4]).arrays().items():
        np.testing.assert_array_equal(array, second.arrays()[name], err_msg=name)
    np.testing.assert_array_equal(joined.time, first.time)


def test_the_judged_point_is_the_box_else_the_gripper_else_the_point() -> None:
    arm = recording(1)
    np.testing.assert_array_equal(arm.judged, arm.gripper_position)
    pose = np.full((1, 5, 7), 0.5)
    assert recording(1, object_pose=pose).judged.shape == (1, 5, 3)
    point = recording(1, gripper_position=None, position=np.ones((1, 5, 2)))
    assert point.judged[0, 0].tolist() == [1, 1, 0]
    with pytest.raises(ValueError, match="no position"):
        _ = recording(1, gripper_position=None).judged


def test_only_what_is_there_is_stored() -> None:
    assert "position" not in recording(1).arrays() and "gripper_position" in recording(1).arrays()
    assert not recording(2).judged_by(np.zeros(2, dtype=bool)).success.any()
