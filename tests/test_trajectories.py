import numpy as np
import pytest

from skillcli.trajectories import Trajectories


def recording(episodes: int, steps: int = 4, **changes: object) -> Trajectories:
    rng = np.random.default_rng(episodes)
    e, t = episodes, steps
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


def test_a_longer_clock_adds_rest_and_nothing_else() -> None:
    short = recording(2, length=np.array([4, 3]))
    longer = short.padded(6)
    assert longer.time.tolist() == pytest.approx([0, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3])
    for name, array in longer.arrays().items():
        old = short.arrays()[name]
        if name in ("target", "success", "length"):
            np.testing.assert_array_equal(array, old, err_msg=name)
        elif name != "time":
            np.testing.assert_array_equal(array[:, : old.shape[1]], old, err_msg=name)
            rest = 0 if name in ("action", "reward") else old[:, -1:]
            added = array[:, old.shape[1] :]
            assert added.shape[1] == 2 and (added == rest).all(), name
            assert array.dtype == old.dtype, name
    assert short.padded(4) is short


def test_recordings_of_different_length_are_joined_on_the_longest_clock() -> None:
    short, long = recording(2, steps=3), recording(1, steps=5)
    for joined, first in ((Trajectories.join([short, long]), [0, 1]), (Trajectories.join([long, short]), [1, 2])):
        assert joined.length.tolist() == ([3, 3, 5] if first[0] == 0 else [5, 3, 3])
        np.testing.assert_array_equal(joined.time, long.time)
        assert joined.skill.shape == (3, 5) and joined.achieved_goal.shape == (3, 6, 3)
        for name, array in joined.select(first).arrays().items():
            np.testing.assert_allclose(array, short.padded(5).arrays()[name], rtol=1e-15, err_msg=name)


def test_the_judged_point_is_the_box_else_the_gripper_else_the_point() -> None:
    arm = recording(1)
    np.testing.assert_array_equal(arm.achieved_goal, arm.gripper_position)
    pose = np.full((1, 5, 7), 0.5)
    pushed = recording(1, object_pose=pose).achieved_goal
    assert pushed.shape == (1, 5, 3) and pushed[0, 0].tolist() == [0.5, 0.5, 0], "in the plane of the table"
    point = recording(1, gripper_position=None, position=np.ones((1, 5, 2)))
    assert point.achieved_goal[0, 0].tolist() == [1, 1, 0]
    with pytest.raises(ValueError, match="no position"):
        _ = recording(1, gripper_position=None).achieved_goal


def test_only_what_is_there_is_stored() -> None:
    assert "position" not in recording(1).arrays() and "gripper_position" in recording(1).arrays()
    assert not recording(2).with_success(np.zeros(2, dtype=bool)).success.any()
