"""What the pictures read out of trajectories, against numbers worked by hand."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from skillcli.trajectories import Trajectories
from skillcli.viz import motion
from skillcli.viz.palette import latent_look, look
from skillcli.viz.scene import Runs


def test_a_waypoint_is_passed_where_the_path_leads_away_again() -> None:
    line = np.array([[x, 0.0, 0.0] for x in (0.0, 0.8, 0.95, 1.1, 2.0, 3.0)])
    targets = np.array([[1.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
    # 0.8 is within 0.3 but 0.95 is nearer; from 0.95 (0.05) the path goes to 1.1 (0.1), so row 2 passes
    assert motion.passed(line, targets, 0.3).tolist() == [0, 0, 0, 1, 1, 1, 2]


def test_waypoints_count_in_order_only() -> None:
    line = np.array([[3.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    assert motion.passed(line, np.array([[1.0, 0.0], [3.0, 0.0]]), 0.1).tolist() == [0, 0, 1, 1]


def _along(points: list[float], waypoints: list[float]) -> motion.Scene:
    """A point task that runs along x through these places, one step each."""
    base = scenes.make("compose", "point")
    count = len(points)
    data = base.trajectories.select([0])
    position = np.stack([np.array(points), np.zeros(count)], axis=-1)[None]
    steps = count - 1
    data = replace(
        data,
        time=0.05 * np.arange(count),
        position=position,
        latent=data.latent[:, :steps],
        skill=data.skill[:, :steps],
        action=data.action[:, :steps],
        reward=data.reward[:, :steps],
        length=np.array([steps]),
    )
    spots = np.array([[x, 0.0, 0.0] for x in waypoints])
    route = np.zeros(len(spots), dtype=int)
    return replace(base, trajectories=data, waypoints=spots, waypoint_route=route, tolerance=0.3)


def test_the_nearest_pass_counts_only_while_due_and_the_last_waypoint_stays_due() -> None:
    scene = _along([0.0, 0.9, 2.0, 2.8, 2.7, 2.95], [1.0, 3.0])
    assert motion.closest(scene, 0) == pytest.approx([0.1, 0.05])
    assert motion.reached(scene, 0).tolist() == [0.0, 0.5, 0.5, 0.5, 0.5, 1.0], "where it is closest, as the judge says"


def test_waypoints_that_are_missed_are_measured_in_their_order() -> None:
    assert motion.closest(_along([0.0, 0.1, 0.2], [1.0, 3.0]), 0) == pytest.approx([0.8, 2.8])


def test_distance_is_to_the_waypoint_that_is_due() -> None:
    scene = _along([0.0, 0.9, 2.0, 2.8], [1.0, 3.0])
    assert motion.distance(scene, 0) == pytest.approx([1.0, 0.1, 1.0, 0.2])


def test_a_box_is_judged_in_the_table_plane() -> None:
    scene = scenes.make("embed-means", "push")
    data = scene.trajectories
    assert data.object_pose is not None
    lifted = data.object_pose.copy()
    lifted[..., 2] += 0.5
    raised = replace(scene, trajectories=replace(data, object_pose=lifted))
    assert motion.distance(raised, 0) == pytest.approx(motion.distance(scene, 0))


def test_pieces_are_cut_where_the_skill_changes_and_a_blend_is_one_piece() -> None:
    scene = _along([0.0] * 7, [1.0])
    latent = np.array([[[1.0, 0], [1, 0], [0.8, 0], [0.6, 0], [0, 0], [0, 0]]])
    skill = np.array([[0, 0, -1, -1, 1, 1]])
    scene = replace(scene, trajectories=replace(scene.trajectories, latent=latent, skill=skill))
    assert motion.pieces(scene, 0) == [(0, 2, 0), (2, 4, -1), (4, 6, 1)]


def test_two_held_latents_between_skills_stay_two_pieces() -> None:
    scene = _along([0.0] * 5, [1.0])
    latent = np.array([[[1.0, 0], [1, 0], [0.5, 0], [0.5, 0]]])
    scene = replace(scene, trajectories=replace(scene.trajectories, latent=latent, skill=np.full((1, 4), -1)))
    assert motion.pieces(scene, 0) == [(0, 2, -1), (2, 4, -1)]


def test_a_sampled_latent_belongs_to_the_skill_whose_goal_it_had() -> None:
    scene = scenes.make("pretrain", "reach", sampled=2)
    skills = [motion.episode_skill(scene, episode) for episode in range(scene.trajectories.episodes)]
    assert skills == [*range(8), *(k for k in range(8) for _ in range(2))]
    assert motion.mean_episodes(scene) == {k: k for k in range(8)}


def test_a_transfer_plays_the_worst_domain_and_episode_first() -> None:
    scene = scenes.make("transfer-eval", "point")
    gaps = np.linalg.norm(scene.trajectories.achieved_goal[:, -1] - scene.trajectories.target, axis=-1)
    played = motion.played(scene)
    assert len(played) == 15 and played[0] == int(gaps.argmax())
    of = [[e for e in played if e // 6 == d] for d in range(3)]
    for domain, chosen in enumerate(of):
        order = [6 * domain + int(e) for e in np.argsort(-gaps[6 * domain : 6 * domain + 6])]
        assert chosen == [order[0], order[1], order[2], order[3], order[5]]
    assert played == [e for chosen in sorted(of, key=lambda chosen: -gaps[chosen[0]]) for e in chosen]


def test_episodes_that_span_a_domain_are_the_worst_three_a_middle_one_and_the_best() -> None:
    gaps = np.array([0.1, 0.9, 0.3, 0.5, 0.7, 0.2, 0.4, 0.6, 0.8])
    assert motion.spanning(list(range(9)), gaps, 5) == [1, 8, 4, 3, 0]
    assert motion.spanning(list(range(9)), gaps, 2) == [1, 0], "few: the worst and the best"
    assert motion.spanning([3, 4, 5], gaps, 5) == [4, 3, 5]
    assert motion.spanning([0, 1, 2], np.array([0.2, 0.2, 0.2]), 5) == [0], "what ends alike is seen once"


def test_what_was_sent_is_measured_by_its_own_route() -> None:
    scene = routed()
    again = replace(
        scene,
        runs=Runs.DOMAINS,
        source=scene.trajectories,
        episode_source=np.array([0, 1]),
        episode_labels=("nominal 0", "nominal 1"),
    )
    sent = motion.sent(again)
    assert sent is not None and motion.closest(sent, 1) == pytest.approx([0.2])
    assert motion.sent(scene) is None


@pytest.mark.parametrize("name", ["episode_source", "latency"])
def test_a_scene_refuses_a_source_or_parameters_that_do_not_match(name: str) -> None:
    wrong = {"episode_source": np.zeros(5, dtype=int)} if name == "episode_source" else {"parameters": {name: np.zeros(5)}}
    with pytest.raises(ValueError, match=rf"{name} has 5 rows, expected \d"):
        replace(scenes.make("transfer-eval", "point"), **wrong)


def test_labels_name_their_domain() -> None:
    assert [motion.domain(label) for label in ("real-like 4", "my lab 12", "nominal")] == [
        "real-like",
        "my lab",
        "nominal",
    ]


def routed() -> motion.Scene:
    """Two routes along x: one goes by 1 and 3, and the other, of two steps and a rest, by -1."""
    first, second = _along([0.0, 0.9, 2.0, 2.8], [1.0, 3.0]), _along([0.0, -0.5, -0.8], [-1.0])
    return replace(
        first,
        trajectories=Trajectories.join([first.trajectories, second.trajectories]),
        waypoints=np.concatenate([first.waypoints, second.waypoints]),
        waypoint_route=np.array([0, 0, 1]),
        episode_route=np.array([0, 1]),
        episode_labels=("there 1", "there 2"),
    )


def test_an_episode_is_measured_by_the_waypoints_of_its_own_route() -> None:
    scene = routed()
    assert motion.due_in(scene, 0)[:, 0].tolist() == [1, 3] and motion.due_in(scene, 1)[:, 0].tolist() == [-1]
    assert motion.distance(scene, 0) == pytest.approx([1, 0.1, 1, 0.2])
    assert motion.distance(scene, 1) == pytest.approx([1, 0.5, 0.2]), "and to its own end"
    assert motion.closest(scene, 0) == pytest.approx([0.1, 0.2]) and motion.closest(scene, 1) == pytest.approx([0.2])
    assert motion.reached(scene, 0).tolist() == [0, 0.5, 0.5, 1] and motion.reached(scene, 1).tolist() == [0, 0, 1]


def test_a_transfer_runs_the_routes_in_turn() -> None:
    scene = routed()
    again = replace(
        scene,
        runs=Runs.DOMAINS,
        trajectories=scene.trajectories.select([1, 0, 1]),
        episode_route=np.array([1, 0, 1]),
        episode_labels=("nominal 0", "nominal 1", "nominal 2"),
    )
    assert [motion.closest(again, episode).tolist() for episode in range(3)] == [
        pytest.approx([0.2]), pytest.approx([0.1, 0.2]), pytest.approx([0.2]),
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["waypoint_route", "episode_route"])
def test_a_scene_refuses_routes_that_do_not_match(name: str) -> None:
    with pytest.raises(ValueError, match=rf"{name} has 5 rows, expected \d"):
        replace(routed(), **{name: np.zeros(5, dtype=int)})


def test_a_scene_refuses_labels_that_do_not_match_its_episodes() -> None:
    scene = scenes.make("compose", "point")
    with pytest.raises(ValueError, match="episode_labels has 2 rows, expected 1"):
        replace(scene, episode_labels=("a", "b"))


def test_a_blend_has_the_colours_of_both_its_ends() -> None:
    scene = scenes.make("compose", "reach")
    piece = motion.Piece(0, 10, -1)
    blend = np.linspace(scene.means[0], scene.means[1], 11)[None, :10]
    data = replace(scene.trajectories, latent=np.concatenate([blend, scene.trajectories.latent[:1, 10:]], axis=1))
    middle = motion.piece_look(replace(scene, trajectories=data), 0, piece)
    assert middle == latent_look(-1, (scene.means[0] + scene.means[1]) / 2, scene.means)
    assert motion.piece_look(scene, 0, motion.Piece(0, 1, 3)) == look(3)
