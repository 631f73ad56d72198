"""Plans written by hand: `3,4,8,7`, with durations and blends `3:1.0,3~4:1.0,4:1.0`, or latents between `3~4@0.25:0.5`.

An entry is a skill `A`; a blend `A~B` from the mean of A to the mean of B; `A~B@λ`, which holds the latent
(1-λ) z_a + λ z_b; or any latent in brackets, `[0.3;-1.2]`: `written` writes plays so. A duration in seconds may follow after a
colon. Commas, spaces or lines separate entries; a `#` begins a comment. A skill is given by its name or its number, counted
from 1.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from skillcli.composition.method import (
    MethodSettings,
    MethodSpec,
    Option,
    PlanningProblem,
    PlanResult,
    WrittenRequest,
    WrittenRoute,
)
from skillcli.composition.plan import Segment
from skillcli.config.base import value
from skillcli.errors import UsageError
from skillcli.kinds import PLAY
from skillcli.trajectories import Array

LONGEST, LONGEST_PLAN = 600.0, 3600.0  # s, the longest entry and the longest plan
_LATENT = re.compile(r"\[(?P<latent>[^\[\]]*)\](?::(?P<seconds>[^~@:]+))?")
_ENTRY = re.compile(r"(?P<a>[^~@:]+)(?:~(?P<b>[^~@:]+)(?:@(?P<share>[^~@:]+))?)?(?::(?P<seconds>[^~@:]+))?")


class SequenceSettings(MethodSettings):
    """Settings of a plan written by hand."""

    plan: str = value("", "such as 3,4,8,7 or 3:1.0,3~4:1.0,3~4@0.25:0.5 (see --plan), or a file that holds one")
    seconds: float = value(1.0, "how long an entry without a duration lasts", "s", gt=0, le=60)


@dataclass(frozen=True)
class Entry:
    """One entry of a plan."""

    text: str  # entry without its duration
    a: int  # index of the skill, -1 for a latent
    b: int | None  # index of the skill at the end of the blend, None for the mean of `a` alone
    share: float | None  # λ, held; None for a blend from 0 to 1
    seconds: float
    latent: tuple[float, ...] = ()  # of an entry that names no skill

    def target(self, goals: Array) -> Array:
        """Return the goal of this entry, (3,) m, from the goals of the skills (K, 3) m."""
        if self.b is None:
            return _row(goals, self.a)
        share = 1.0 if self.share is None else self.share
        target: Array = (1 - share) * goals[self.a] + share * goals[self.b]
        return target

    def segment(self, means: Array, period: float) -> Segment:
        """Convert to a segment, with the means of the skills (K, d) and control steps of `period` s.

        Raises:
            UsageError: its latent has another size than the means.
        """
        steps = max(1, round(self.seconds / period))
        if self.latent:
            if len(self.latent) != means.shape[1]:
                raise UsageError(
                    f"plan entry {self.text!r}: a latent of this library has {means.shape[1]} numbers, got {len(self.latent)}",
                    "separate them by semicolons: [Z1;Z2;…]",
                )
            return Segment(np.array(self.latent), -1, self.text, steps)
        if self.b is None:
            return Segment(means[self.a], self.a, self.text, steps)
        if self.share is None:
            return Segment(means[self.a], -1, self.text, steps, until=means[self.b])
        skill = {0.0: self.a, 1.0: self.b}.get(self.share, -1)
        return Segment((1 - self.share) * means[self.a] + self.share * means[self.b], skill, self.text, steps)


def parse(text: str, names: Sequence[str], seconds: float) -> list[Entry]:
    """Parse a plan.

    Args:
        text: in the syntax of this module.
        names: names of the skills.
        seconds: duration of an entry without one.

    Raises:
        UsageError: the text is empty, names an unknown skill, or has an invalid share, latent or duration.
    """
    words = re.sub(r"#.*", "", text).replace(",", " ").split()
    if not words:
        raise UsageError("the plan is empty", "for example --plan 3,4,8,7 or 3:1.0,3~4:1.0,4:1.0")
    entries = [_latent(word, seconds) if word.startswith("[") else _entry(word, names, seconds) for word in words]
    if sum(entry.seconds for entry in entries) > LONGEST_PLAN:
        raise UsageError(f"the plan lasts longer than {LONGEST_PLAN:g} s", "shorten it")
    return entries


def skill_index(text: str, names: Sequence[str]) -> int:
    """Return the index of a skill given by name, or by number counted from 1.

    Raises:
        UsageError: no skill has this name or number.
    """
    if text in names:
        return list(names).index(text)
    if re.fullmatch(r"[0-9]{1,6}", text) and 1 <= int(text) <= len(names):
        return int(text) - 1
    numbered = "" if names[0] == "1" else f", or their numbers 1 to {len(names)}"
    raise UsageError(f"no skill {text!r} in this library", f"skills: {', '.join(names)}{numbered}")


def waypoints(entries: Sequence[Entry], goals: Array) -> list[Array]:
    """Return the goals of the held entries, (3,) m each; of the last blend's end if the plan only blends.

    Raises:
        UsageError: the plan names no skill, so it has no goal of its own.
    """
    named = [entry for entry in entries if not entry.latent]
    if not named:
        raise UsageError("the plan holds latents only, which have no goals of their own", "say by --goal where it should end")
    held = [entry.target(goals) for entry in named if entry.b is None or entry.share is not None]
    return held or [named[-1].target(goals)]


def _entry(word: str, names: Sequence[str], seconds: float) -> Entry:
    found = _ENTRY.fullmatch(word)
    if not found:
        raise UsageError(f"plan entry {word!r} cannot be read", "SKILL, A~B or A~B@SHARE, then :SECONDS where wanted")
    lasts = _seconds(found["seconds"], word, seconds)
    share = None if found["share"] is None else _number(found["share"], word)
    if share is not None and not 0 <= share <= 1:
        raise UsageError(
            f"plan entry {word!r}: λ must lie in [0, 1], got {share:g}", "A~B@0.25 is a quarter of the way from A to B"
        )
    second = None if found["b"] is None else skill_index(found["b"], names)
    return Entry(word.partition(":")[0], skill_index(found["a"], names), second, share, lasts)


def _latent(word: str, seconds: float) -> Entry:
    found = _LATENT.fullmatch(word)
    if not found:
        raise UsageError(f"plan entry {word!r} cannot be read", "a latent is written [Z1;Z2;…], then :SECONDS where wanted")
    latent = tuple(_number(part, word) for part in found["latent"].split(";"))
    return Entry(word.partition("]")[0] + "]", -1, None, None, _seconds(found["seconds"], word, seconds), latent)


def _seconds(text: str | None, word: str, usual: float) -> float:
    lasts = usual if text is None else _number(text, word)
    if not 0 < lasts <= LONGEST:
        raise UsageError(f"plan entry {word!r} must last between 0 and {LONGEST:g} seconds, got {lasts:g}", "SKILL:SECONDS")
    return lasts


def written(latent: Array, skill: Array, names: Sequence[str], period: float) -> str:
    """Write the latents (T, d) and skills (T,) of control steps of `period` s as a plan that repeats them."""
    changed = (np.diff(skill) != 0) | ((skill[1:] < 0) & (np.diff(latent, axis=0) != 0).any(axis=1))
    cuts = [0, *(np.flatnonzero(changed) + 1).tolist(), len(skill)]
    entries = []
    for start, stop in pairwise(cuts):
        index = int(skill[start])
        named = names[index] if index >= 0 and not re.search(r"[~@:,\s\[#]", names[index]) else ""
        held = named or "[" + ";".join(f"{value:.9g}" for value in latent[start]) + "]"
        entries.append(f"{held}:{(stop - start) * period:.9g}")
    return ",".join(entries)


def _number(text: str, word: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise UsageError(f"plan entry {word!r}: {text!r} is not a number", "for example 3:1.0 or 3~4@0.25")
    return number


def _row(goals: Array, index: int) -> Array:
    row: Array = goals[index]
    return row


def plan(problem: PlanningProblem) -> PlanResult:
    """Return the written plan unchanged."""
    return PlanResult([entry.segment(problem.mean, problem.period) for entry in problem.entries])


def write(request: WrittenRequest) -> list[WrittenRoute]:
    """Write the typed plan; its waypoints are the given goals, else the goals of the skills that it holds."""
    settings = request.settings
    assert isinstance(settings, SequenceSettings)
    if not settings.plan.strip():
        raise UsageError("the plan is empty: --method sequence needs --plan", "for example --plan 3,4,8,7")
    entries = tuple(parse(settings.plan, request.names, settings.seconds))
    asked = request.routes() if request.task or request.goals else ()
    if len(asked) > 1:
        raise UsageError(f"task {request.task!r} has {len(asked)} routes, a plan by hand has one", "give --goal instead")
    return [WrittenRoute(entries, asked[0] if asked else np.array(waypoints(entries, request.places)))]


def plan_text(plan: str) -> str:
    """Return a plan as typed, or the content of the file that it names.

    Raises:
        UsageError: it looks like a file and cannot be read.
    """
    path = Path(plan)
    if not ("/" in plan or path.suffix in (".txt", ".plan") or (len(plan) < 256 and path.is_file())):
        return plan
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text"
        raise UsageError(
            f"plan file {plan!r} cannot be read: {reason}", "a plan is text, such as 3:1.0,3~4:1.0,4:1.0"
        ) from None


METHOD = MethodSpec(
    name="sequence",
    settings=SequenceSettings,
    plan=plan,
    hint="give its entries more time, or let --method search find a plan",
    options=(
        Option(
            "plan",
            "The plan, such as 3,4,8,7 or 3:1.0,3~4:1.0,3~4@0.25:0.5 or [0.3;-1.2]:0.5, a file, or the id of a play.",
            "PLAN",
            read=plan_text,
            stored=PLAY.name,
        ),
        Option("seconds", "Duration of an entry that names none, 1 s by default.", "SECONDS", float),
    ),
    write=write,
)
