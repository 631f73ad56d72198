"""`skill compose --method NAME`: what its help shows, what every method reports, and what is refused."""

from __future__ import annotations

import re
import shutil
import tempfile
from pathlib import Path
from typing import Any

import pytest
import torch
from command import files, made, skill
from sb3_file import write_model

from skillcli.composition.registry import METHODS, all_specs

SPECS = all_specs()
OPTIONS = {name: spec.option_names for name, spec in SPECS.items()}
SPECIAL = {option for options in OPTIONS.values() for option in options}
GOAL = ("--goal", "0.6,0.1,0.25")
SHORT = tuple(
    word
    for setting in (
        "ddpg.simulations=4", "ddpg.seconds=0.5", "ddpg.gradient_steps=2", "ddpg.warm_up=1", "ddpg.good_enough=0",
        "ppo.simulations=4", "ppo.seconds=0.5", "ppo.epochs=2", "ppo.good_enough=0",
        "sb3.seconds=0.5", "mpc.samples=8", "mpc.elites=2", "mpc.seconds=0.5", "interpolate.shares=3",
    )
    for word in ("--set", setting)
)  # fmt: skip
TYPED: dict[str, tuple[str, ...]] = {
    "search": GOAL,
    "map": (*GOAL, "--trials", "2"),
    "interpolate": ("--skills", "3,4,8", "--hold", "0.2", "--blend", "0.1"),
    "sequence": ("--plan", "3:0.2,3~4:0.2,3~4@0.25:0.1,4:0.2"),
    "ddpg": (*GOAL, "--iterations", "3", "--seed", "1"),
    "ppo": (*GOAL, "--iterations", "3", "--seed", "1"),
    "mpc": (*GOAL, "--lookahead", "2", "--seed", "1"),
    "sb3": (*GOAL, "--policy", str(write_model(Path(tempfile.mkdtemp()) / "model.zip"))),
}
KEYS = {
    "id", "method", "task", "success", "planning_seconds", "expanded_nodes", "simulated_robot_seconds", "segments", "waypoints",
    "final_distance_m",
}  # fmt: skip


@pytest.fixture(scope="module")
def composed(chain: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """A store with one composition of every method, and what each reported."""
    store = shutil.copytree(chain, tmp_path_factory.mktemp("methods") / "artifacts")
    found = {
        method: made("--store", store, "compose", "tiny/embed-means", "--method", method, "--name", method, *words, *SHORT)
        for method, words in TYPED.items()
    }
    return store, found


def shown_options(*words: str) -> set[str]:
    result = skill("compose", *words, "--help")
    assert result.code == 0, result.err
    return set(re.findall(r"--([a-z]+)", result.out)) & SPECIAL


def test_the_command_line_knows_every_method_there_is() -> None:
    assert METHODS.keys() == TYPED.keys()
    assert [spec.name for spec in SPECS.values()] == list(METHODS)


@pytest.mark.parametrize("method", OPTIONS)
def test_help_shows_the_options_of_the_method_and_no_others(method: str) -> None:
    assert shown_options("--method", method) == set(OPTIONS[method])


def test_plain_help_shows_the_methods_and_none_of_their_options() -> None:
    assert shown_options() <= {"method"}
    out = skill("compose", "--help").out
    assert all(f"{method}:" in out for method in OPTIONS)


@pytest.mark.parametrize("method", TYPED)
def test_every_method_reports_the_same_keys_and_writes_a_sound_artifact(
    composed: tuple[Path, dict[str, Any]], method: str
) -> None:
    store, found = composed
    report = found[method]
    assert report.keys() >= KEYS and report["method"] == method
    assert all(segment.keys() >= {"skill", "latent", "seconds"} for segment in report["segments"])
    assert all(waypoint.keys() >= {"target", "closest_m"} for waypoint in report["waypoints"])
    assert sum(s["seconds"] for s in report["segments"]) == pytest.approx(report["plan_seconds"])
    assert made("--store", store, "verify", report["id"])["ok"]


@pytest.mark.parametrize("method", TYPED)
def test_every_composition_can_be_transferred(composed: tuple[Path, dict[str, Any]], method: str) -> None:
    store, found = composed
    words = ("transfer-eval", found[method]["id"], "--domain", "mild", "--episodes", "2", "--name", f"{method}-t")
    assert made("--store", store, *words)["domains"][0]["episodes"] == 2


@pytest.mark.parametrize("method", ["interpolate", "ddpg", "sb3"])  # with blends, and with latents that are no skill's
def test_blends_and_any_latents_can_be_drawn(composed: tuple[Path, dict[str, Any]], method: str, tmp_path: Path) -> None:
    store, found = composed
    rrd, png = tmp_path / "x.rrd", tmp_path / "x.png"
    made("--store", store, "viz", found[method]["id"], "-o", rrd, "--png", png)
    assert rrd.stat().st_size > 1000 and png.stat().st_size > 1000


@pytest.mark.parametrize("method", [name for name, spec in SPECS.items() if spec.draws])
def test_the_same_seed_gives_the_same_content(composed: tuple[Path, dict[str, Any]], method: str) -> None:
    store, found = composed
    again = made(
        "--store", store, "compose", "tiny/embed-means", "--method", method, "--name", f"{method}-2", *TYPED[method], *SHORT
    )
    hashes = [made("--store", store, "show", id_)["content_sha256"] for id_ in (found[method]["id"], again["id"])]
    assert hashes[0] == hashes[1] and again["seed"] == 1


@pytest.mark.parametrize("method", TYPED)
def test_weights_and_curves_are_kept_of_what_learns(composed: tuple[Path, dict[str, Any]], method: str) -> None:
    store, found = composed
    arrays = made("--store", store, "show", found[method]["id"])["arrays"]
    kept = {name.split("/")[0] for name in arrays} & {"composer", "curves"}
    assert kept == ({"composer", "curves"} if SPECS[method].learns else {"composer"} if method == "sb3" else set())


def test_interpolation_reports_its_calibration(composed: tuple[Path, dict[str, Any]]) -> None:
    found = composed[1]["interpolate"]
    calibration = found["calibration"]
    assert len(calibration["pairs"]) == 28 and calibration["neighbours"]["pair_count"] == 12, "the edges of the cuboid"
    assert calibration["mean_error"] == pytest.approx(sum(pair["error"] for pair in calibration["pairs"]) / 28)
    assert [s["skill"] for s in found["segments"]] == ["3", "3~4", "4", "4~8", "8"]


def test_a_plan_may_stand_in_a_file(composed: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    store, found = composed
    plan = tmp_path / "plan.txt"
    plan.write_text("3:0.2  # first\n3~4:0.2\n3~4@0.25:0.1, 4:0.2\n", encoding="utf-8")
    again = made("--store", store, "compose", "tiny/embed-means", "--method", "sequence", "--name", "f", "--plan", plan)
    assert again["segments"] == found["sequence"]["segments"]


BAD: list[tuple[tuple[str, ...], int, str]] = [
    (("--method", "magic", "--plan", "3"), 2, "no method 'magic'"),
    (("--method", "mpc", "--plan", "3"), 2, "--plan belongs to --method sequence, not to mpc"),
    (("--plan=3",), 2, "--plan belongs to --method sequence, not to search"),
    (
        ("--method", "sequence", "--seed", "1", "--plan", "3"),
        2,
        "--seed belongs to --method search or map or ddpg or ppo or mpc",
    ),
    (("--method", "sequence"), 2, "the plan is empty"),
    (("--method", "sequence", "--plan", " "), 2, "the plan is empty"),
    (("--method", "sequence", "--plan", "9"), 2, "no skill '9'"),
    (("--method", "sequence", "--plan", "3~4@1.5"), 2, "λ must lie in [0, 1]"),
    (("--method", "sequence", "--plan", "nowhere/plan.txt"), 2, "cannot be read"),
    (("--method", "interpolate", "--goal", "0.6,0,0.2"), 2, "goes through skills, not to goals"),
    (("--method", "interpolate", "--task", "triangle"), 2, "no interpolation 'triangle'"),
    (("--method", "interpolate", "--skills", "3"), 2, "two skills"),
    (("--method", "interpolate", "--skills", "3,north"), 2, "no skill 'north'"),
    (("--method", "mpc", "--task", "u-shape"), 2, "use --method interpolate --task u-shape"),
    (("--method", "ddpg", "--latents", "all"), 2, "ddpg.latents"),
    (("--method", "ddpg", "--iterations", "0"), 2, "ddpg.iterations"),
    (("--method", "mpc", "--set", "mpc.elites=48"), 2, "elites must be fewer"),
    (("--method", "mpc", "--set", "training.iterations=9", *GOAL), 2, "trained on another recipe"),
    (("--method", "sb3", *GOAL), 2, "--method sb3:FILE.zip"),
    (("--method", "sb3:none.zip", *GOAL), 2, "none.zip cannot be read"),
    (("--method", "search:none.zip", *GOAL), 2, "--method search takes no value"),
    (("--method", f"sb3:{__file__}", *GOAL), 2, "is not a model that Stable-Baselines3 saved"),
    (("--heuristic", "magic", *GOAL), 2, "no heuristic 'magic'"),
]


@pytest.mark.parametrize("method", ["ddpg", "ppo"])
def test_a_composer_that_comes_apart_says_so_and_writes_nothing(
    chain: Path, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ruin(optimizer: torch.optim.Adam) -> None:
        for group in optimizer.param_groups:
            for weight in group["params"]:
                weight.data.fill_(torch.nan)

    monkeypatch.setattr(torch.optim.Adam, "step", ruin)
    before = files(chain)
    words = ("--method", method, "--iterations", "8", *GOAL, *SHORT)
    result = skill("--store", chain, "--json", "compose", "tiny/embed-means", *words)
    assert result.code == 1 and f"training of the {method} composer diverged" in result.json["error"]["message"], result
    assert files(chain) == before


@pytest.mark.parametrize(("words", "code", "said"), BAD, ids=[" ".join(words[:4]) for words, _, _ in BAD])
def test_what_cannot_be_done_ends_in_one_line_and_writes_nothing(
    chain: Path, words: tuple[str, ...], code: int, said: str
) -> None:
    before = files(chain)
    result = skill("--store", chain, "--json", "compose", "tiny/embed-means", *words)
    assert result.code == code, result
    error = result.json["error"]
    assert said in f"{error['message']} {error['hint']}" and error["hint"], error
    assert files(chain) == before
