"""Target domains: robots that differ from the simulation, as ranges of parameters drawn anew for every episode.

A domain is a TOML file, shipped (`presets/`) or anybody's own; docs/domains.md says how to write one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from skillcli.errors import UsageError
from skillcli.perturbation import PARAMETERS, Range, Ranges, closest

PRESETS = (
    "nominal", "random-starts", "mild", "real-like", "peng", "dactyl",
    "latency-40", "latency-80", "low-friction", "high-friction", "weak-gains",
)  # fmt: skip
_FOLDER = Path(__file__).parent / "presets"
_MAX_BYTES = 64 * 1024
_HELP = "docs/domains.md says how to write one; `skill domains real-like` shows an example"


@dataclass(frozen=True)
class Domain:
    """A named target: what differs from the source, by how much, and why."""

    name: str
    description: str
    parameters: dict[str, Range]


class _File(BaseModel):
    """A domain as it is written. A name is also part of a path in the store, hence its letters."""

    model_config = ConfigDict(extra="forbid")

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,39}$")]
    description: Annotated[str, Field(max_length=500)] = ""
    extends: str | None = None
    parameters: Ranges = {}


def find_domain(text: str) -> Domain:
    """A preset by its name, or the domain of a TOML file by its path: what ends in .toml or has a slash in it is a path.

    Raises:
        UsageError: there is none, or its file is not one of a domain.
    """
    if text.endswith(".toml") or "/" in text or "\\" in text:
        domain = _load(Path(text).expanduser())
        if domain.name in PRESETS:
            raise UsageError(f"domain file {text}: the name {domain.name!r} is that of a preset", "give it a name of its own")
        return domain
    if text not in PRESETS:
        known = f"domains: {', '.join(PRESETS)}; see `skill domains`, or give the path of a .toml file"
        raise UsageError(f"no domain {text!r}{closest(text, PRESETS)}", known)
    return _preset(text)


def find_domains(texts: Iterable[str]) -> list[Domain]:
    """Several domains; results are kept by their names, so no two may share one.

    Raises:
        UsageError: one is unknown or no domain, or two have the same name.
    """
    found: dict[str, tuple[str, Domain]] = {}
    for text in texts:
        domain = find_domain(text)
        if domain.name in found:
            raise UsageError(
                f"{found[domain.name][0]} and {text} are both called {domain.name!r}",
                "name each domain once, by a name of its own",
            )
        found[domain.name] = text, domain
    return [domain for _, domain in found.values()]


@cache
def _preset(name: str) -> Domain:
    return _load(_FOLDER / f"{name}.toml")


def _load(path: Path) -> Domain:
    content = _content(path)
    base = content.get("extends")
    if isinstance(base, str):
        if base not in PRESETS:
            hint = f"presets: {', '.join(PRESETS)}; a domain extends one of these"
            raise UsageError(f"domain file {path}: extends: no preset {base!r}{closest(base, PRESETS)}", hint)
        own = content.get("parameters", {})
        content = {**content, "parameters": {**_preset(base).parameters, **own} if isinstance(own, dict) else own}
    try:
        found = _File.model_validate(content)
    except ValidationError as error:
        raise UsageError(*_explain(path, error)) from error
    return Domain(found.name, found.description, found.parameters)


def _content(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            raw = file.read(_MAX_BYTES + 1)
        if len(raw) > _MAX_BYTES:
            raise UsageError(f"domain file {path} is larger than {_MAX_BYTES // 1024} kB", f"is it a domain? {_HELP}")
        return tomllib.loads(raw.decode("utf-8"))
    except FileNotFoundError:
        raise UsageError(f"no domain file {path}", f"presets: {', '.join(PRESETS)}; {_HELP}") from None
    except (OSError, ValueError, RecursionError) as error:  # ValueError: no UTF-8, no TOML, or numbers of absurd length
        raise UsageError(f"domain file {path} cannot be read: {error}", f"a domain is a TOML file; {_HELP}") from None


def _explain(path: Path, error: ValidationError) -> tuple[str, str]:
    """One line and a hint out of pydantic's report, for its first complaint."""
    first = error.errors()[0]
    key = ".".join(str(part) for part in first["loc"][:2])
    if first["type"] == "extra_forbidden":
        return _unknown_field(path, key)
    if first["type"] == "missing":
        return f"domain file {path}: {key} is missing", f'for example {key} = "worn-gripper"; {_HELP}'
    said = first["msg"].removeprefix("Value error, ")
    if first["type"] == "string_pattern_mismatch":
        said = "begins with a letter or digit, and has at most 40 letters, digits and _ . -"
    given = first["input"]
    shown = f", got {given!r}" if isinstance(given, str | int | float) and len(repr(given)) < 80 else ""
    return f"domain file {path}: {key}: {said}{shown}", _HELP


def _unknown_field(path: Path, key: str) -> tuple[str, str]:
    if key in PARAMETERS:
        return (
            f"domain file {path}: {key} is a parameter and stands in the wrong place",
            f"write it below [parameters]; {_HELP}",
        )
    said = f"domain file {path}: unknown field {key!r}{closest(key, _File.model_fields)}"
    return said, f"fields: {', '.join(_File.model_fields)}; {_HELP}"
