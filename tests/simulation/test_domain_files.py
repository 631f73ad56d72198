"""Domains as files: what is read, what is refused and how."""

from __future__ import annotations

from pathlib import Path

import pytest
from ranges import log_uniform, one_of, uniform

from skillcli.config.randomization import IDENTITY, PARAMETERS, Distribution
from skillcli.errors import UsageError
from skillcli.simulation.domains import PRESETS, find_domain


def written(folder: Path, text: str | bytes) -> str:
    path = folder / "own.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return str(path)


def test_a_file_is_a_preset_with_changes(tmp_path: Path) -> None:
    domain = find_domain(
        written(
            tmp_path,
            """
            name = "worn-gripper"
            description = "as real-like, but slippery"
            extends = "real-like"
            [parameters]
            contact_friction = { log_uniform = [0.3, 0.6] }
            joint_offset = { values = [0.01, 0, 0, 0, 0, 0, 0] }
            latency = 0.0
            """,
        )
    )
    assert (domain.name, domain.description) == ("worn-gripper", "as real-like, but slippery")
    base = find_domain("real-like").parameters
    assert domain.parameters.keys() == base.keys() | {"joint_offset"}
    assert domain.parameters["contact_friction"] == log_uniform(0.3, 0.6)
    assert domain.parameters["joint_offset"] == Distribution(kind="fixed", values=(0.01, 0, 0, 0, 0, 0, 0))
    assert domain.parameters["latency"] == one_of(0) and domain.parameters["gain"] == base["gain"]
    assert base["latency"] == one_of(0, 0.05), "the preset itself stays"


def test_a_file_needs_no_more_than_a_name(tmp_path: Path) -> None:
    domain = find_domain(written(tmp_path, 'name = "calm"'))
    assert domain.parameters == {} and domain.description == ""


@pytest.mark.parametrize(
    ("text", "said", "hint"),
    [
        ('name = "a', "cannot be read", "TOML"),
        (b"name = '\xff'", "cannot be read", "TOML"),
        ("a = " + "[" * 5000, "cannot be read", "TOML"),
        ("a = " + "9" * 5000, "cannot be read", "TOML"),
        ("#" * 270_000, "larger than 256 kB", "docs/domains.md"),
        ("", "name is missing", 'name = "worn-gripper"'),
        ("name = 3", "name: expected text in quotes, got 3", ""),
        ('name = "a/b"', "name: expected a letter or digit", ""),
        ('name = ""', "name: expected a letter or digit", ""),
        ('name = "..."', "name: expected a letter or digit", ""),
        ('name = "real-like"', "that of a preset", "a name of its own"),
        (f'name = "a"\ndescription = "{"x" * 501}"', "description: ", ""),
        ('name = "a"\nparametres = {}', "unknown field 'parametres', did you mean 'parameters'", "fields: name"),
        ('name = "a"\ngain = 2.0', "gain is a parameter and stands in the wrong place", "below [parameters]"),
        ('name = "a"\nextends = "real_like"', "extends: no preset 'real_like', did you mean 'real-like'", "presets: nominal"),
        ('name = "a"\nextends = "../../other"', "extends: no preset", "presets: nominal"),
        ('name = "a"\nextends = ["mild"]', "extends: expected text in quotes, got a list", ""),
        ('name = "a"\nparameters = 3', "parameters: expected a table of keys, got 3", ""),
        ('name = "a"\nextends = "mild"\nparameters = 3', "parameters: expected a table of keys", ""),
        ('name = "a"\n[parameters]\ngian = 2.0', "no parameter 'gian', did you mean 'gain'", "docs/domains.md"),
        ('name = "a"\n[parameters]\nwind = 2.0', "no parameter 'wind'; parameters: link_mass", "docs/domains.md"),
        ('name = "a"\n[parameters]\nobject_mass = -1', "object_mass must lie between 0.01 and 100 as a factor, got -1", ""),
        ('name = "a"\n[parameters]\nlatency = 3', "latency must lie between 0 and 0.155 s, got 3", ""),
        ('name = "a"\n[parameters]\nobject_size = {uniform=[1, 1e9]}', "object_size must lie between", ""),
        ('name = "a"\n[parameters]\ngain = {uniform=[2, 1]}', "parameters.gain: uniform takes [low, high]", ""),
        ('name = "a"\n[parameters]\ngain = {normal=[1, 1]}', "parameters.gain: expected a number, or one of", ""),
        ('name = "a"\n[parameters]\ngain = "strong"', "parameters.gain: expected a number, or one of", ""),
        ('name = "a"\n[parameters]\ngain = [1, 2]', "parameters.gain: expected a number, or one of", ""),
        ('name = "a"\n[parameters]\ntable_tilt = {values=[0.1]}', "table_tilt has 2 values in each episode, got 1", ""),
        ('name = "a"\n[parameters]\ngain = nan', "parameters.gain: expected a finite number, got nan", ""),
        ('name = "a"\n[parameters]\njoint_drift = 0.01', "joint_drift has no effect without drift_time", ""),
    ],
)
def test_a_malformed_file_is_refused_with_file_field_and_fix(tmp_path: Path, text: str | bytes, said: str, hint: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(UsageError) as caught:
        find_domain(path)
    assert caught.value.exit_code == 2
    assert path in caught.value.message and said in caught.value.message and hint in caught.value.hint
    assert "\n" not in caught.value.message.replace(path, "") or "cannot be read" in caught.value.message
    assert caught.value.hint


@pytest.mark.parametrize("path", ["absent.toml", "./absent", "absent/absent.toml"])
def test_an_absent_file_is_a_usage_error_too(path: str) -> None:
    with pytest.raises(UsageError, match="no domain file") as caught:
        find_domain(path)
    assert "real-like" in caught.value.hint


def test_a_folder_is_no_domain(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        find_domain(f"{tmp_path}/")


def test_a_misspelt_preset_is_recognised() -> None:
    with pytest.raises(UsageError, match="no domain 'latency40', did you mean 'latency-40'"):
        find_domain("latency40")


def test_every_shipped_file_is_listed_and_says_what_it_is() -> None:
    folder = Path(find_domain.__code__.co_filename).parent / "presets"
    assert {path.stem for path in folder.glob("*.toml")} == set(PRESETS)
    for name in PRESETS:
        domain = find_domain(name)
        assert domain.name == name and len(domain.description) > 20
        for parameter, values in domain.parameters.items():
            assert set(values.values) != {IDENTITY[parameter]}, "what is named differs"


def test_what_results_were_compared_on_stays_at_least_as_hard() -> None:
    real, mild = find_domain("real-like").parameters, find_domain("mild").parameters
    assert real["contact_friction"] == real["object_mass"] == uniform(0.6, 1.4) and real["gain"] == uniform(0.7, 1.3)
    assert real["latency"] == one_of(0, 0.05)
    assert real["joint_noise"] == one_of(0.005) and real["position_noise"] == one_of(0.003)
    assert mild["contact_friction"] == uniform(0.9, 1.1) and mild["gain"] == uniform(0.95, 1.05)


def test_the_documentation_knows_every_parameter_and_preset_as_they_are() -> None:
    text = (Path(__file__).parents[2] / "docs" / "domains.md").read_text()
    for name, p in PARAMETERS.items():
        assert f"| `{name}` | {p.size or 'joints'} | {p.unit} | {p.low:g} .. {p.high:g} | {p.meaning} |" in text
    assert all(f"`{name}`" in text for name in PRESETS)
