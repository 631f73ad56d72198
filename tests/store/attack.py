"""What `skill` makes of hostile files: each in verify, show and import, and in whatever uses it after an import.

    python -m tests.store.attack [CASE…]

A case is FAMILY.NAME or the beginning of it; without one, all. Prints a line for every command that does wrong, and at the
end how many did. `--all` prints every command. Right is: exit code 0 or 1, one line of error, no traceback and no
"unexpected", one JSON object under --json, little time and memory, what the case says about refusing, and a store that is
as whole after an import as it was before.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

sys.path[:0] = [str(Path(__file__).parent)]

from hostile import CASES, Case, Good  # noqa: E402
from hostile.good import NAME  # noqa: E402

SKILL = str(Path(sys.executable).with_name("skill"))
MEGABYTES = 500.0
WALL = 20.0  # where nothing else runs
STORE = ("verify", "show", "import", "gc", "ls")
CPU, CPU_OF_USE = 5.0, 20.0  # seconds; two of the latter are loading torch and mujoco
USES = {
    "pretrain": (("embed-means", "ID", "--name", "used"), ("transfer-eval", "ID", "--domain", "nominal", "--episodes", "2")),
    "embed-means": (
        ("compose", "ID", "--name", "used", "--method", "sequence", "--set", "sequence.plan=1,2"),
        ("transfer-eval", "ID", "--domain", "nominal", "--episodes", "2"),
    ),
    "compose": (("transfer-eval", "ID", "--domain", "mild", "--episodes", "2"),),
    "transfer-eval": (),
}
SHOWN = ("header", "texts", "attributes", "meaning")  # the others are read by one function, whoever asks
USED = ("meaning", "texts")  # other families hold the content of the good file, if they can be read at all
VIZ = ("viz", "ID", "--output", "OUT.rrd", "--png", "OUT.png")


@dataclass(frozen=True)
class Outcome:
    """What one command did."""

    case: str
    words: str
    code: int
    cpu: float
    megabytes: float
    line: str  # the first of its stderr, or of its stdout
    problems: tuple[str, ...]

    def __str__(self) -> str:
        wrong = f"  <- {', '.join(self.problems)}" if self.problems else ""
        used = f"{self.cpu:5.1f} s {self.megabytes:5.0f} MB"
        return f"{self.case:50} {self.words:12} {self.code:4} {used}  {self.line[:110]!a}{wrong}"


class Ended(NamedTuple):
    code: int
    out: str
    err: str
    cpu: float
    megabytes: float
    hung: bool


def run(words: Sequence[str], folder: Path) -> Ended:
    """Run `skill` in a group of its own, ended after `WALL` seconds; what its children use counts as its own."""
    out, err = folder / "out", folder / "err"
    started = time.monotonic()
    environment = {**os.environ, "COLUMNS": "120", "NO_COLOR": "1", "OMP_NUM_THREADS": "1"}
    with out.open("wb") as o, err.open("wb") as e:
        process = subprocess.Popen(
            [SKILL, *words], stdout=o, stderr=e, stdin=subprocess.DEVNULL, cwd=folder, env=environment,
            start_new_session=True, preexec_fn=_limit,
        )  # fmt: skip
    done, wall = 0, WALL * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
    while not done and time.monotonic() - started < wall:
        done, status, used = os.wait4(process.pid, os.WNOHANG)
        time.sleep(0 if done else 0.01)
    if not done:
        os.killpg(process.pid, signal.SIGKILL)
        _, status, used = os.wait4(process.pid, 0)
    process.returncode = code = os.waitstatus_to_exitcode(status)
    texts = [path.read_bytes()[: 4 << 20].decode(errors="surrogateescape") for path in (out, err)]
    return Ended(code, *texts, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, done == 0)


def _limit() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (60, 60))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (2 << 30, 2 << 30))


def judge(case: str, words: Sequence[str], ended: Ended, right: str = "either") -> Outcome:
    """Compare what a command did with what is right."""
    command = next(word for word in words if not word.startswith(("-", "/")))
    lines = [line for line in ended.err.splitlines() if line]
    problems = []
    if ended.hung:
        problems.append("hangs")
    elif ended.code < 0:
        problems.append(f"dies of {signal.Signals(-ended.code).name}")
    elif ended.code not in ((0, 1) if command in STORE else (0, 1, 2)):
        problems.append(f"exit {ended.code}")
    if "Traceback" in ended.err + ended.out:
        problems.append("traceback")
    if "unexpected:" in ended.err:
        problems.append("unexpected")
    if ended.code == 1 and sum(line.startswith("error:") for line in lines) > 1:
        problems.append("more than one error")
    if ended.code > 0 and not ended.err and not ended.out:
        problems.append("says nothing")
    if [mark for mark in ended.err + ended.out if not (mark.isprintable() or mark == "\n")]:
        problems.append("prints raw characters")
    if "--json" in words and ended.code >= 0 and not _is_one_object(ended.out):
        problems.append("not one JSON object")
    if ended.cpu > (CPU if command in STORE else CPU_OF_USE):
        problems.append("slow")
    if ended.megabytes > MEGABYTES:
        problems.append("large")
    if right != "either" and ended.code in (0, 1) and (ended.code == 1) != (right == "refused"):
        problems.append("accepted" if right == "refused" else "refused")
    line = next(iter(lines or ended.out.splitlines()), "")
    label = " ".join(word for word in words if word in ("--json", "--all", command))
    return Outcome(case, label, ended.code, ended.cpu, ended.megabytes, line, tuple(problems))


def _is_one_object(text: str) -> bool:
    try:
        return isinstance(json.loads(text), dict)
    except ValueError:
        return False


def attack(case: Case, good: Good, folder: Path) -> Iterator[Outcome]:
    """Everything that is done with one case; the folder is empty."""
    file = folder / "hostile.file"
    build(case, good, file)

    def skill(*words: str, right: str = "either") -> Outcome:
        return judge(case.name, words, run(words, folder), right)

    if case.form == "checkpoint":
        yield from _resumed(case, folder)
        return
    if case.form == "reuse":
        yield from _reused(case, file, folder)
        return
    one = f"{NAME}/{case.kind}-v1"
    placed = _store(good, folder / "placed")
    if case.form == "artifact":
        path = placed / f"{one}.h5"
        path.parent.mkdir()
        shutil.copyfile(file, path)
        yield skill("--store", str(placed), "verify", one, right=case.right)
        if case.family in SHOWN:
            yield skill("--store", str(placed), "show", one)
            yield skill("--store", str(placed), "--json", "show", one)
        if case.family == "header":
            yield skill("--store", str(placed), "--json", "ls")
            yield skill("--store", str(placed), "ls")
    shutil.rmtree(placed)
    store = _store(good, folder / "imported")
    known = _artifacts(store)
    imported = skill("--store", str(store), "--json", "import", str(file), right=case.right)
    yield imported
    new = sorted(_artifacts(store) - known)
    if imported.code != 0:
        if new:
            yield Outcome(case.name, "import", imported.code, 0, 0, f"refused, and kept {new}", ("kept",))
        return
    yield skill("--store", str(store), "--quiet", "verify", "--all", right="accepted")
    yield skill("--store", str(store), "--json", "gc")
    for one in new[-1:] if case.family in USED else ():
        kind = one.partition("/")[2].rpartition("-v")[0]
        for words in (*USES[kind], VIZ):
            named = [{"ID": one, "OUT.rrd": str(folder / "o.rrd"), "OUT.png": str(folder / "o.png")}.get(w, w) for w in words]
            yield skill("--store", str(store), "--json", *named)


def build(case: Case, good: Good, file: Path) -> None:
    """Write the file of a case, in a process of its own: what making it takes must not count for what comes after."""
    child = os.fork()
    if not child:
        try:
            data = case.build(good)
            if case.form == "checkpoint":
                from hostile.checkpoints import place

                file = place(file.parent / "imported")
                file.parent.mkdir(parents=True)
            file.write_bytes(data)
            os._exit(0)
        except Exception:
            traceback.print_exc()
        finally:  # whatever happens, it never goes on as a second one of us
            os._exit(1)
    assert os.waitpid(child, 0)[1] == 0, f"{case.name} could not be made"


def _resumed(case: Case, folder: Path) -> Iterator[Outcome]:
    from hostile.checkpoints import SETTINGS

    store = folder / "imported"
    words = ("--store", str(store), "--json", "pretrain", "point", "--name", NAME, "--resume", *SETTINGS)
    yield judge(case.name, words, run(words, folder), case.right)
    words = ("--store", str(store), "--json", "gc")
    yield judge(case.name, words, run(words, folder))


def _reused(case: Case, file: Path, folder: Path) -> Iterator[Outcome]:
    """Imported or not, it must not be taken for the training that `run` was asked for."""
    from hostile.reuse import SETTINGS

    store = folder / "imported"
    words: tuple[str, ...] = ("--store", str(store), "--json", "import", str(file))
    yield judge(case.name, words, run(words, folder), case.right)
    known = _artifacts(store)
    words = ("--store", str(store), "--json", "run", "point", "--name", NAME, *SETTINGS)
    outcome = judge(case.name, words, run(words, folder))
    trained = {one for one in _artifacts(store) - known if "/pretrain-" in one}
    problems = outcome.problems if trained or outcome.code else (*outcome.problems, "used as finished work")
    yield replace(outcome, problems=problems)


def _store(good: Good, root: Path) -> Path:
    shutil.copytree(good.root, root / good.root.name)
    return root


def _artifacts(root: Path) -> set[str]:
    return {str(path.relative_to(root).with_suffix("")) for path in root.rglob("[!.]*.h5")}


def chosen(names: Sequence[str]) -> list[Case]:
    return [case for name, case in CASES.items() if not names or any(name.startswith(start) for start in names)]


def main(words: Sequence[str]) -> int:
    good, wrong, cases = Good(), 0, 0
    for case in chosen([word for word in words if not word.startswith("-")]):
        cases += 1
        with tempfile.TemporaryDirectory(prefix="attack-") as folder:
            for outcome in attack(case, good, Path(folder)):
                wrong += bool(outcome.problems)
                if outcome.problems or "--all" in words:
                    print(outcome, flush=True)
    print(f"{cases} cases, {wrong} commands did wrong")
    return 1 if wrong or not cases else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
