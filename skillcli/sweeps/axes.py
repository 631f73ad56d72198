"""What a sweep varies: seeds, and `KEY=A,B,C` or `KEY=LOW..HIGH` for each key of the recipe."""

from __future__ import annotations

import itertools
import math
import random
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from skillcli.errors import UsageError

MAX_CELLS = 20_000  # of one sweep
_CLOSING = {"[": "]", "{": "}", "(": ")"}
_RANGE = re.compile(r"(?P<low>[-+.\de]+?)\.\.(?P<high>[-+.\de]+)(?P<log>:log)?", re.IGNORECASE)

Setting = tuple[tuple[str, str], ...]
"""Keys with their values, as typed."""


@dataclass(frozen=True)
class Choice:
    """A key with the values that it may have, as typed."""

    key: str
    values: tuple[str, ...]

    @property
    def varies(self) -> bool:
        """Return whether there is more than one value."""
        return len(self.values) > 1

    def draw(self, rng: random.Random) -> str:
        """Draw one of the values."""
        return rng.choice(self.values)


@dataclass(frozen=True)
class Span:
    """A key with a range of numbers: whole ones if both ends are written as such."""

    key: str
    low: float
    high: float
    whole: bool
    log: bool
    varies = True

    def draw(self, rng: random.Random) -> str:
        """Draw a value, uniformly or uniformly in its logarithm."""
        if self.log:
            value = math.exp(rng.uniform(math.log(self.low), math.log(self.high)))
        elif self.whole:
            return str(rng.randint(int(self.low), int(self.high)))
        else:
            value = rng.uniform(self.low, self.high)
        return str(round(value)) if self.whole else f"{value:.6g}"


Axis = Choice | Span


def axis(text: str) -> Axis:
    """Read `KEY=A,B,C`, `KEY=LOW..HIGH` or `KEY=LOW..HIGH:log`.

    Raises:
        UsageError: it is none of them.
    """
    key, equals, raw = text.partition("=")
    key = key.strip()
    if not equals or not key or not raw.strip():
        raise UsageError(f"--set {text!r}: expected KEY=A,B,C", "for example --set training.iterations=20,40")
    if found := _RANGE.fullmatch(raw.strip()):
        return _span(key, found)
    values = split_values(raw)
    if repeated := next((value for value in values if values.count(value) > 1), None):
        raise UsageError(f"--set {key}: {repeated} stands twice", "give each value once")
    if "" in values:
        raise UsageError(f"--set {text!r}: a value is empty", "write every value between commas, texts in quotes")
    return Choice(key, tuple(values))


def split_values(text: str) -> list[str]:
    """Split at commas, but not inside of brackets and quotes.

    Raises:
        UsageError: a bracket or a quote is not closed.
    """
    parts, open_brackets, quote, escaped = [""], list[str](), "", False
    for letter in text:
        if quote:
            quote = "" if letter == quote and not escaped else quote
            escaped = letter == "\\" and not escaped and quote == '"'
        elif letter in "\"'":
            quote = letter
        elif letter in _CLOSING:
            open_brackets.append(_CLOSING[letter])
        elif letter in _CLOSING.values():
            if not open_brackets or open_brackets.pop() != letter:
                raise UsageError(f"{text!r}: {letter} closes nothing", "balance the brackets")
        elif letter == "," and not open_brackets:
            parts.append("")
            continue
        parts[-1] += letter
    if quote or open_brackets:
        raise UsageError(f"{text!r}: {(quote or open_brackets[-1])} is missing at the end", "close brackets and quotes")
    return [part.strip() for part in parts]


def seeds(text: str) -> list[int]:
    """Read `0-9`, `3` or `0,2,5-7`.

    Raises:
        UsageError: it is no list of seeds, or one stands twice.
    """
    found: list[int] = []
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d{1,18})\s*(?:-\s*(\d{1,18})\s*)?", part, re.ASCII)
        if not ends:
            raise UsageError(
                f"--seeds {text!r}: expected numbers of at most 18 digits, and ranges",
                "for example --seeds 0-9 or --seeds 0,2,5-7",
            )
        low, high = int(ends[1]), int(ends[2] or ends[1])
        if high < low:
            raise UsageError(f"--seeds {text!r}: {low}-{high} holds none", f"write {high}-{low}")
        if high - low >= MAX_CELLS:
            raise UsageError(f"--seeds {text!r}: {high - low + 1:,} seeds, at most {MAX_CELLS:,} cells", "give fewer")
        found += range(low, high + 1)
    if len(set(found)) < len(found):
        raise UsageError(f"--seeds {text!r}: a seed stands twice", "give each seed once")
    return found


def grid(axes: Sequence[Axis]) -> list[Setting]:
    """Combine every value with every other, the last key fastest.

    Raises:
        UsageError: an axis is a range, a key stands twice, or there are too many.
    """
    _check_keys(axes)
    choices = []
    for each in axes:
        if isinstance(each, Span):
            raise UsageError(f"--set {each.key}: a grid has no ranges", "give values, or --random N or --optuna N")
        choices.append([(each.key, value) for value in each.values])
    if (count := math.prod(map(len, choices))) > MAX_CELLS:
        raise UsageError(f"{count:,} settings, at most {MAX_CELLS:,} cells", "give fewer values, or --random N")
    return list(itertools.product(*choices))


def drawn(axes: Sequence[Axis], count: int) -> list[Setting]:
    """Draw settings at random, each once; the same axes and count give the same ones.

    Raises:
        UsageError: there is nothing to draw, a key stands twice, or there are not that many settings.
    """
    _check_keys(axes)
    if not axes:
        raise UsageError("--random draws values, and there are none", "give --set KEY=A,B,C or --set KEY=LOW..HIGH")
    if all(isinstance(each, Choice) for each in axes) and count <= MAX_CELLS:
        every = math.prod(len(each.values) for each in axes if isinstance(each, Choice))
        if count > every:
            raise UsageError(f"--random {count}: there are {every} settings", "leave it out to run all of them")
    rng, found = random.Random(0), dict[Setting, None]()
    for setting in itertools.islice(_draws(axes, rng), 1000 * count):
        found[setting] = None
        if len(found) == count:
            return list(found)
    raise UsageError(f"--random {count}: only {len(found)} different settings were found", "give wider ranges, or fewer")


def _draws(axes: Sequence[Axis], rng: random.Random) -> Iterator[Setting]:
    while True:
        yield tuple((each.key, each.draw(rng)) for each in axes)


def _check_keys(axes: Sequence[Axis]) -> None:
    keys = [each.key for each in axes]
    if repeated := next((key for key in keys if keys.count(key) > 1), None):
        raise UsageError(f"--set {repeated} stands twice", f"give all its values at once: --set {repeated}=A,B,C")


def _span(key: str, found: re.Match[str]) -> Span:
    texts = found["low"], found["high"]
    try:
        low, high = map(float, texts)
    except ValueError:
        raise UsageError(f"--set {key}={found[0]}: expected numbers at both ends", "for example 1e-4..1e-2:log") from None
    log = bool(found["log"])
    if not (math.isfinite(low) and math.isfinite(high) and low < high) or (log and low <= 0):
        asked = "0 < LOW < HIGH" if log else "LOW < HIGH"
        ways = [f"write {texts[1]}..{texts[0]}"] if math.isfinite(low) and math.isfinite(high) and low > high else []
        if log and min(low, high) <= 0:
            ways = ["give ends above 0, or leave out :log"]
        raise UsageError(
            f"--set {key}={found[0]}: expected {asked}", *(ways or ["give two different numbers, the lower one first"])
        )
    whole = all(re.fullmatch(r"[-+]?\d+", text) for text in texts)
    return Span(key, low, high, whole, log)
