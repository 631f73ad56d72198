"""Target domains: robots that differ from the simulation, as distributions of parameters drawn for every episode.

A domain is a TOML file, bundled (`presets/`) or the user's; docs/domains.md says how to write one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, ValidationError

from skillcli.config.base import Section
from skillcli.config.explain import complaint
from skillcli.config.randomization import PARAMETERS, Distribution, Distributions, closest
from skillcli.config.toml_file import read_toml
from skillcli.errors import UsageError
from skillcli.kinds.outcome import DOMAIN_NAME
from skillcli.kinds.transfer_eval import MOST_DOMAINS
from skillcli.paths import expanded

PRESETS = (
    "nominal", "random-starts", "mild", "real-like", "peng", "dactyl",
    "latency-40", "latency-80", "low-friction", "high-friction", "weak-gains", "sawyer-recorded",
)  # fmt: skip
_FOLDER = Path(__file__).parent / "presets"
_HELP = "docs/domains.md says how to write one; `skill domains real-like` shows an example"


@dataclass(frozen=True)
class Domain:
    """A named target: which parameters differ from the source, by how much, and why."""

    name: str
    description: str
    parameters: dict[str, Distribution]


def _fit_for_a_path(name: str) -> str:
    if not DOMAIN_NAME.fullmatch(name):
        raise ValueError("expected a letter or digit, then at most 39 letters, digits and _ . -")
    return name


class _File(Section):
    """A domain as it is written. Its name is part of a path in the store, hence the allowed characters."""

    name: Annotated[str, AfterValidator(_fit_for_a_path)]
    description: Annotated[str, Field(max_length=500)] = ""
    extends: str | None = None
    parameters: Distributions = Field(default_factory=dict)


def find_domain(text: str) -> Domain:
    """Find a preset by name, or read a TOML file: a text that ends in .toml or contains a slash is a path.

    Raises:
        UsageError: there is none, or the file is not a domain.
    """
    if text.endswith(".toml") or "/" in text or "\\" in text:
        domain = _load(expanded(text))
        if domain.name in PRESETS:
            raise UsageError(f"domain file {text}: the name {domain.name!r} is that of a preset", "give it a name of its own")
        return domain
    if text not in PRESETS:
        known = f"domains: {', '.join(PRESETS)}; see `skill domains`, or give the path of a .toml file"
        raise UsageError(f"no domain {text!r}{closest(text, PRESETS)}", known)
    return _preset(text)


def find_domains(texts: Iterable[str]) -> list[Domain]:
    """Find several domains; results are stored by name, so names must differ.

    Raises:
        UsageError: one is unknown or invalid, two have the same name, or there are too many.
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
        if len(found) > MOST_DOMAINS:
            raise UsageError(f"more than {MOST_DOMAINS} domains are given", "evaluate them in several runs")
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
        raise UsageError(*_explained(path, error)) from error
    return Domain(found.name, found.description, found.parameters)


def _content(path: Path) -> dict[str, Any]:
    try:
        return read_toml(path)
    except FileNotFoundError:
        raise UsageError(f"no domain file {path}", f"presets: {', '.join(PRESETS)}; {_HELP}") from None
    except (OSError, ValueError) as error:
        raise UsageError(f"domain file {path} cannot be read: {error}", f"a domain is a TOML file; {_HELP}") from None


def _explained(path: Path, error: ValidationError) -> tuple[str, str]:
    """Return one line and a hint for the first error."""
    found = complaint(error, _File)
    if found.kind == "unknown":
        return _unknown_field(path, found.key)
    if found.kind == "missing":
        return f"domain file {path}: {found.key} is missing", f'for example {found.key} = "worn-gripper"; {_HELP}'
    return f"domain file {path}: {found.key}{found.entry}: {found.said}", _HELP


def _unknown_field(path: Path, key: str) -> tuple[str, str]:
    if key in PARAMETERS:
        return (
            f"domain file {path}: {key} is a parameter and stands in the wrong place",
            f"write it below [parameters]; {_HELP}",
        )
    said = f"domain file {path}: unknown field {key!r}{closest(key, _File.model_fields)}"
    return said, f"fields: {', '.join(_File.model_fields)}; {_HELP}"
