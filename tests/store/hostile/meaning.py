# ruff: noqa: E501 - tables of one case a line
"""Well-formed artifacts that cannot be true: numbers, shapes and sizes against recipe and kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .case import add
from .forge import Forged
from .good import Good

Edit = Callable[[Forged], object]


def edited(kind: str, *edits: Edit) -> Callable[[Good], bytes]:
    def build(good: Good) -> bytes:
        copy = good.forged(kind)
        for edit in edits:
            edit(copy)
        return copy.file()

    return build


def fill(path: str, value: float, index: Any = (0,)) -> Edit:
    """One number, or some, of an array."""

    def edit(copy: Forged) -> None:
        copy.arrays[path] = np.array(copy.arrays[path])
        copy.arrays[path][index] = value

    return edit


def become(path: str, value: Any) -> Edit:
    return lambda copy: copy.arrays.update({path: np.asarray(value)})


def cast(path: str, dtype: str) -> Edit:
    return lambda copy: copy.arrays.update({path: copy.arrays[path].astype(dtype)})


def lose(*prefixes: str) -> Edit:
    def edit(copy: Forged) -> None:
        copy.arrays = {path: array for path, array in copy.arrays.items() if not path.startswith(prefixes)}

    return edit


def recipe(section: str, **values: Any) -> Edit:
    return lambda copy: copy.texts["recipe"].update({section: {**copy.texts["recipe"].get(section, {}), **values}})


def whole(**values: Any) -> Edit:
    """Keys of the recipe that are in no section."""
    return lambda copy: copy.texts["recipe"].update(values)


def result(**values: Any) -> Edit:
    return lambda copy: copy.texts["results"].update(values)


def only_result(**values: Any) -> Edit:
    return lambda copy: copy.texts.update(results=values)


def skills(count: int) -> Edit:
    """So many skills in arrays, recipe and results, the networks as they were."""

    def edit(copy: Forged) -> None:
        goals = np.resize(copy.arrays["skills/goal"], (count, 3))
        copy.arrays |= {
            f"embedding/{name}": np.resize(copy.arrays[f"embedding/{name}"], (count, 2)) for name in ("mean", "std")
        }
        copy.arrays["skills/goal"] = goals
        for name, array in list(copy.arrays.items()):
            if name.startswith("evaluation/"):
                copy.arrays[name] = np.resize(array[:, :1], (count, 1, *array.shape[2:]))

    return edit


LAST = "weights/policy.body.4.weight"
FIRST = "weights/policy.body.0.weight"
EVERYTHING: dict[str, dict[str, tuple[Edit, ...]]] = {
    "pretrain": {
        "mean_is_nan": (fill("embedding/mean", np.nan),),
        "mean_is_infinite": (fill("embedding/mean", np.inf),),
        "mean_is_huge": (fill("embedding/mean", 1e300),),
        "std_is_zero": (fill("embedding/std", 0.0, ...),),
        "std_below_zero": (fill("embedding/std", -1.0, ...),),
        "std_is_nan": (fill("embedding/std", np.nan, ...),),
        "goal_is_infinite": (fill("skills/goal", np.inf),),
        "goal_is_not_the_recipes": (fill("skills/goal", 1.5),),
        "weight_is_nan": (fill(LAST, np.nan),),
        "weight_is_infinite": (fill(FIRST, np.inf),),
        "log_std_is_huge": (fill("weights/policy.log_std", 3e38, ...),),
        "normalizer_variance_below_zero": (fill("weights/normalizer.variance", -1.0, ...),),
        "normalizer_variance_is_zero": (fill("weights/normalizer.variance", 0.0, ...),),
        "normalizer_count_is_nan": (become("weights/normalizer.count", np.float32(np.nan)),),
        "normalizer_count_is_a_list": (become("weights/normalizer.count", np.ones(3, np.float32)),),
        "embedding_weights_differ": (fill("weights/embedding.raw_mean", 0.25, ...),),
        "no_weights": (lose("weights/"), become("weights/other", np.zeros(2, np.float32))),
        "no_policy": (lose("weights/policy."),),
        "no_normalizer": (lose("weights/normalizer."),),
        "one_weight_missing": (lose(LAST),),
        "one_weight_more": (become("weights/policy.body.6.weight", np.zeros((2, 2), np.float32)),),
        "scalar_weight": (become(LAST, np.float32(0)),),
        "scalar_log_std": (become("weights/policy.log_std", np.float32(0)),),
        "scalar_normalizer": (become("weights/normalizer.mean", np.float32(0)),),
        "empty_normalizer": (become("weights/normalizer.mean", np.zeros(0, np.float32)),),
        "empty_log_std": (become("weights/policy.log_std", np.zeros(0, np.float32)),),
        "weight_of_another_shape": (become(LAST, np.zeros((3, 128), np.float32)),),
        "weight_turned": (become(LAST, np.zeros((128, 2), np.float32)),),
        "weight_of_seven_dimensions": (become(LAST, np.zeros((1, 1, 1, 1, 1, 2, 128), np.float32)),),
        "weight_of_whole_numbers": (become(LAST, np.zeros((2, 128), np.int64)),),
        "weight_of_truths": (become(LAST, np.zeros((2, 128), bool)),),
        "weight_of_half_size": (cast(LAST, "<f2"),),
        "weights_of_twice_the_size": (cast(LAST, "<f8"),),
        "log_std_of_a_million": (become("weights/policy.log_std", np.zeros(1_000_000, np.float32)),),
        "normalizer_of_a_million": (become("weights/normalizer.mean", np.zeros(1_000_000, np.float32)),),
        "privileged_normalizer_of_a_million": (become("weights/privileged_normalizer.mean", np.zeros(1_000_000, np.float32)),),
        "other_hidden_layers": (recipe("network", policy_hidden=[64, 64]),),
        "hidden_layers_of_4096": (recipe("network", **{k: [4096] * 30 for k in ("policy_hidden", "value_hidden")}),),
        "hidden_layers_by_the_thousand": (recipe("network", policy_hidden=[1] * 20_000),),
        "no_hidden_layers": (recipe("network", policy_hidden=[], value_hidden=[], inference_hidden=[]),),
        "window_of_6400000": (recipe("embedding", window=6_400_000),),
        "latent_of_a_million": (recipe("embedding", size=1_000_000),),
        "latent_of_3": (recipe("embedding", size=3),),
        "horizon_of_a_billion": (recipe("task", horizon=10**9),),
        "horizon_of_a_million": (recipe("task", horizon=10**6),),
        "goals_by_the_million": (recipe("task", goals=[[0.0, 3.0]] * 70_000),),
        "skills_by_the_million": (skills(1_000_000),),
        "skills_by_the_hundred": (skills(100), recipe("task", goals=[[0.0, 3.0]] * 100)),
        "no_skills": (skills(0), recipe("task", goals=[])),
        "one_skill": (skills(1), recipe("task", goals=[[0.0, 3.0]])),
        "fewer_goals_in_the_recipe": (recipe("task", goals=[[0.0, 3.0]]),),
        "goals_of_nan_as_text": (recipe("task", goals=[["nan", "nan"]] * 4),),
        "goals_far_away": (recipe("task", goals=[[1e300, 1e300]] * 4),),
        "names_of_skills_twice": (recipe("task", names=["a", "a", "b", "c"]),),
        "names_of_markup": (recipe("task", names=["[/]", "[red]", "\x1b[2J", "d"]),),
        "names_of_100_kB": (recipe("task", names=["a" * 100_000, "b", "c", "d"]),),
        "another_task": (recipe("task", name="reach"),),
        "a_robot_file": (recipe("task", robot="/etc/passwd"),),
        "unknown_recipe_key": (recipe("task", surprise=1),),
        "empty_recipe": (lambda copy: copy.texts.update(recipe={}),),
        "recipe_name_alone": (lambda copy: copy.texts.update(recipe={"name": "point"}),),
        "recipe_values_of_other_types": (recipe("task", bound="wide", horizon=[50]),),
        "control_period_of_zero": (recipe("task", control_period=0.0),),
        "control_period_of_a_year": (recipe("task", control_period=3e7),),
        "latents_by_the_billion": (recipe("evaluation", latents=10**9),),
        "episodes_by_the_billion": (recipe("transfer", episodes=10**9),),
        "domains_of_files": (recipe("transfer", domains=["/etc/passwd", "nominal"]),),
        "search_without_end": (recipe("search", budget=10**12, batch=10**6),),
        "search_resolution_of_zero": (recipe("search", resolution=0.0),),
        "step_limit_of_1e300": (recipe("task", step_limit=1e300, bound=1e300),),
        "step_limit_of_1e-300": (recipe("task", step_limit=1e-300, bound=1e-300),),
        "task_file_without_end": (recipe("task", module="/dev/zero"),),
        "task_file_with_a_zero_byte": (recipe("task", module="/tmp/a\0.py"),),
        "task_file_of_a_lone_surrogate": (recipe("task", module="\ud800.py"),),
        "task_file_of_100_kB": (recipe("task", module="/" + "a" * 100_000),),
        "robot_of_a_home_that_is_not": (whole(robot="~nobody-of-that-name/x.toml"),),
        "robot_is_a_device": (whole(robot="/dev/null"),),
        "robot_of_100_kB": (whole(robot="/" + "a" * 100_000),),
        "compose_of_an_unknown_task": (recipe("compose", task="[/]"),),
        "length_beyond": (fill("trajectories/length", 10**6, ...),),
        "length_below_zero": (fill("trajectories/length", -5, ...),),
        "length_as_a_fraction": (cast("trajectories/length", "<f8"),),
        "length_of_the_largest": (fill("trajectories/length", 2**63 - 1, ...),),
        "skill_beyond": (fill("trajectories/skill", 1000, ...),),
        "skill_below": (fill("trajectories/skill", -1000, ...),),
        "skill_as_a_fraction": (cast("trajectories/skill", "<f4"),),
        "position_is_nan": (fill("trajectories/position", np.nan, ...),),
        "position_is_huge": (fill("trajectories/position", 3e38, ...),),
        "position_is_whole": (cast("trajectories/position", "<i8"),),
        "time_runs_backwards": (become("trajectories/time", np.linspace(2.5, 0, 51)),),
        "time_is_nan": (fill("trajectories/time", np.nan, ...),),
        "time_is_huge": (fill("trajectories/time", 1e300, 50),),
        "target_is_nan": (fill("trajectories/target", np.nan, ...),),
        "reward_is_infinite": (fill("trajectories/reward", np.inf, ...),),
        "success_is_a_number": (cast("trajectories/success", "<f8"),),
        "no_episodes": (lambda c: c.arrays.update({k: v[:0] for k, v in c.arrays.items() if "trajectories" in k and "time" not in k}),),
        "joints_beside_the_point": (become("trajectories/joint_position", np.zeros((36, 51, 7), np.float32)),),
        "no_positions_but_joints": (lose("trajectories/position"), become("trajectories/joint_position", np.zeros((36, 51, 0), "f4"))),
        "curve_is_nan": (fill("curves/return", np.nan, ...),),
        "curve_is_infinite": (fill("curves/env_steps", np.inf, ...),),
        "curve_beyond_all_pictures": (become("curves/x", np.array([1e308, -1e308])),),
        "curve_of_nothing": (become("curves/return", np.zeros(0)),),
        "curve_of_a_million": (become("curves/return", np.zeros(1_000_000)),),
        "no_curves": (lose("curves/"), become("curves/x", np.zeros(1))),
        "curve_by_another_name": (become("curves/success/-.=+", np.zeros(115)),),
        "evaluation_is_nan": (fill("evaluation/final_distance", np.nan, ...),),
        "evaluation_of_nothing": (lambda c: c.arrays.update({k: v[:, :0] for k, v in c.arrays.items() if "evaluation" in k}),),
        "distance_below_zero": (fill("evaluation/final_distance", -1.0, ...),),
        "results_of_nothing": (only_result(),),
        "results_without_embedding": (lambda copy: copy.texts["results"].pop("embedding"),),
        "accuracy_is_a_text": (result(embedding={"inference_accuracy": "[/]"}),),
    },
    "embed-means": {
        "mean_is_nan": (fill("embedding/mean", np.nan),),
        "mean_differs_from_its_parent": (fill("embedding/mean", 0.3),),
        "bounds_swapped": (lambda c: c.arrays.update({"embedding/bounds": c.arrays["embedding/bounds"][::-1]}),),
        "bounds_are_infinite": (fill("embedding/bounds", np.inf, ...),),
        "pair_beyond": (fill("halfway/pair", 1000, ...),),
        "pair_of_the_same": (fill("halfway/pair", 0, ...),),
        "places_without_ends": (become("map/place", np.zeros((0, 3))),),
        "pair_below_zero": (fill("halfway/pair", -9, ...),),
        "pair_as_fractions": (cast("halfway/pair", "<f8"),),
        "pairs_by_the_million": (become("halfway/pair", np.zeros((1_000_000, 2), int)),),
        "distance_is_nan": (fill("embedding/latent_distance", np.nan, ...),),
        "goal_is_infinite": (fill("skills/goal", np.inf),),
        "length_beyond": (fill("trajectories/length", 10**6, ...),),
        "fewer_episodes_than_skills": (lambda c: c.arrays.update({k: v[:1] for k, v in c.arrays.items() if "traj" in k and "time" not in k}),),
        "results_of_nothing": (only_result(),),
        "results_name_others": (result(skills=[{"name": "[/]"}] * 9),),
        "another_recipe_than_its_parent": (recipe("task", horizon=51),),
    },
    "compose": {
        "latent_is_nan": (fill("plan/latent", np.nan, ...),),
        "latent_is_huge": (fill("plan/latent", 1e300, ...),),
        "latent_of_another_size": (become("plan/latent", np.zeros((6, 5))),),
        "seconds_below_zero": (fill("plan/seconds", -1.0, ...),),
        "seconds_are_nan": (fill("plan/seconds", np.nan, ...),),
        "seconds_are_infinite": (fill("plan/seconds", np.inf, ...),),
        "seconds_by_the_billion": (fill("plan/seconds", 1e9, ...),),
        "skill_beyond": (fill("plan/skill", 1000, ...),),
        "skill_below": (fill("plan/skill", -1000, ...),),
        "route_beyond": (fill("plan/route", 1000, ...),),
        "routes_by_the_billion": (fill("plan/route", 2**40, ...), fill("waypoints/route", 2**40, ...)),
        "route_below_zero": (fill("plan/route", -7, ...),),
        "route_as_fractions": (cast("plan/route", "<f8"),),
        "waypoint_is_nan": (fill("waypoints/target", np.nan, ...),),
        "waypoint_of_a_route_that_is_none": (fill("waypoints/route", 55, ...),),
        "no_segments": (lambda c: c.arrays.update({k: v[:0] for k, v in c.arrays.items() if k.startswith("plan/")}),),
        "segments_by_the_million": (lambda c: c.arrays.update({k: np.resize(v, (10**6, *v.shape[1:])) for k, v in c.arrays.items() if k.startswith("plan/")}),),
        "first_schema_without_episodes": (lambda c: c.header.update(schema_version=1), become("trajectories/success", np.zeros(0, bool))),
        "no_waypoints": (lambda c: c.arrays.update({k: v[:0] for k, v in c.arrays.items() if k.startswith("waypoints/")}),),
        "calibration_beyond": (become("calibration/pair", np.full((2, 2), 99)), become("calibration/share", np.zeros(3)), become("calibration/end", np.zeros((2, 3, 3)))),
        "results_of_nothing": (only_result(),),
        "method_of_markup": (result(method="[/]", task="[red]"),),
        "method_is_a_list": (result(method=[1]),),
        "segments_are_a_text": (result(segments="[/]"),),
        "routes_are_a_million": (result(routes=10**6),),
    },
    "transfer-eval": {
        "domain_beyond": (fill("episodes/domain", 1000, ...),),
        "domain_below_zero": (fill("episodes/domain", -9, ...),),
        "domain_as_fractions": (cast("episodes/domain", "<f8"),),
        "distance_is_nan": (fill("episodes/final_distance", np.nan, ...),),
        "distance_is_infinite": (fill("episodes/final_distance", np.inf, ...),),
        "no_episodes": (lambda c: c.arrays.update({k: v[:0] for k, v in c.arrays.items() if k.startswith("episodes/")}),),
        "fewer_trajectories": (lambda c: c.arrays.update({k: v[:3] for k, v in c.arrays.items() if "traj" in k and "time" not in k}),),
        "domain_values_are_nan": (fill("domains/mild/contact_friction", np.nan, ...),),
        "domain_of_another_name": (become("domains/..=/x", np.zeros(50)),),
        "unknown_parameter": (become("domains/mild/[x]".replace("[x]", "x"), np.zeros(50)),),
        "parameter_of_several_widths": (become("domains/mild/latency", np.zeros((50, 7))), become("domains/real-like/latency", np.zeros(50))),
        "parameter_of_many_dimensions": (become("domains/mild/latency", np.zeros((50, 2, 3))),),
        "parameter_of_50000_joints": (become("domains/mild/joint_offset", np.zeros((50, 50_000))),),
        "domain_name_of_100_kB": (lambda c: c.texts["results"]["domains"][0].update(name="a" * 100_000),),
        "results_of_nothing": (only_result(),),
        "domains_of_markup": (result(domains=[{"name": "[/]"}]),),
        "domains_are_a_number": (result(domains=3),),
        "success_rate_is_a_text": (result(source={"success_rate": "[/]"}),),
    },
}  # fmt: skip
UNHEARD = {  # nothing that anybody uses, or that a real run cannot give: to be refused or harmless
    "bounds_swapped", "distance_below_zero", "search_resolution_of_zero", "mean_is_huge", "log_std_is_huge",
    "normalizer_variance_is_zero", "embedding_weights_differ", "weights_of_twice_the_size", "weight_of_half_size",
    "horizon_of_a_million", "goals_far_away", "names_of_100_kB", "names_of_markup", "names_of_skills_twice", "control_period_of_a_year",
    "latents_by_the_billion", "episodes_by_the_billion", "domains_of_files", "search_without_end", "another_task", "a_robot_file",
    "robot_of_a_home_that_is_not", "robot_is_a_device",
    "compose_of_an_unknown_task", "position_is_huge", "time_is_huge", "success_is_a_number", "no_episodes", "curve_is_nan",
    "curve_is_infinite", "curve_of_nothing", "curve_of_a_million", "no_curves", "curve_by_another_name", "skills_by_the_hundred",
    "one_skill", "position_is_whole", "reward_is_infinite", "joints_beside_the_point", "evaluation_of_nothing", "pairs_by_the_million",
    "no_waypoints", "latent_is_huge", "distance_is_infinite", "domain_of_another_name", "unknown_parameter", "method_of_markup",
    "distance_is_nan", "domain_values_are_nan", "evaluation_is_nan", "position_is_nan", "results_name_others", "fewer_trajectories",
    "accuracy_is_a_text", "segments_by_the_million", "routes_are_a_million", "mean_differs_from_its_parent", "another_recipe_than_its_parent",
}  # fmt: skip
for kind, cases in EVERYTHING.items():
    for name, edits in cases.items():
        add(f"meaning.{kind}_{name}", edited(kind, *edits), "either" if name in UNHEARD else "refused", kind)
