"""Who may import whom: cli → stages → {envs, learning, composition, store, viz} → the base modules, never up or sideways."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import skillcli

ROOT = Path(skillcli.__file__).parent
BASE = {
    "recipe",
    "section",
    "explain",
    "toml_file",
    "methods",
    "perturbation",
    "pushing",
    "metrics",
    "seeding",
    "errors",
    "plaintext",
    "trajectories",
}
MIDDLE = {"envs", "learning", "composition", "store", "viz"}
BELOW = {"cli": {"cli", "stages"} | MIDDLE | BASE, "stages": {"stages"} | MIDDLE | BASE}
BELOW |= {part: {part} | BASE for part in MIDDLE} | dict.fromkeys(BASE, BASE) | {"__init__": set()}

# package outside: the only parts of ours that may import it
ONLY_IN = {
    "h5py": ("store/",),
    "rerun": ("viz/recording",),
    "torch": ("learning/", "seeding.py"),
    "mujoco": ("envs/", "viz/"),
}


def imports(path: Path) -> Iterator[str]:
    """Every absolute dotted name imported anywhere in a file, inside functions and type checks too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_no_import_points_up_or_sideways() -> None:
    wrong = []
    for path in ROOT.rglob("*.py"):
        name = path.relative_to(ROOT).as_posix()
        part = name.removesuffix(".py").split("/")[0]
        for imported in imports(path):
            package, *rest = imported.split(".")
            if package == "skillcli" and rest[0] not in BELOW[part] | {"__version__"}:
                wrong.append(f"{name} imports {imported}")
            if package in ONLY_IN and not name.startswith(ONLY_IN[package]):
                wrong.append(f"{name} imports {imported}")
    assert not wrong, "\n".join(wrong)


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys; sys.argv = ['skill', '--help']\n"
        "from skillcli.cli.app import main\n"
        "try: main()\n"
        "except SystemExit as leaving: assert not leaving.code\n"
        "heavy = {'torch', 'mujoco', 'h5py', 'rerun', 'matplotlib', 'scipy', 'numpy'} & set(sys.modules)\n"
        "sys.exit(f'loaded {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
