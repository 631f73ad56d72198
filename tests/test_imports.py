"""Who may import whom: downward only, from the command line to the base, never up and never sideways."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import skillcli

ROOT = Path(skillcli.__file__).parent
# From the ground up. What is not named here is the base, which everybody may use.
FLOORS: list[set[str]] = [
    {"config", "kinds"},
    {"robots"},
    {"simulation", "composition", "store"},
    {"learning", "tasks"},
    {"recipe"},
    {"evaluation", "sweeps"},
    {"viz", "execution", "gym"},
    {"stages"},
    {"api"},
    {"cli"},
]
FLOOR = {part: floor for floor, parts in enumerate(FLOORS, 1) for part in parts}
# Though these stand lower.
KEPT_APART = {
    "composition": {"robots"},
    "learning": {"robots", "simulation", "store"},
    "store": {"robots", "config"},
    "tasks": {"composition", "store"},
}

# package outside: the only parts of ours that may import it
ONLY_IN = {
    "fsspec": ("store/remote_fsspec.py",),
    "h5py": ("store/",),
    "onnx": ("execution/",),
    "onnxruntime": ("execution/",),
    "rerun": ("viz/recording",),
    "trimesh": ("viz/play/",),
    "viser": ("viz/play/",),
    "torch": ("learning/", "seeding.py"),
    "mujoco": ("robots/", "simulation/", "tasks/", "viz/"),
    "paramiko": ("store/remote_fsspec.py",),
    "gymnasium": ("gym/",),
    "minari": ("gym/",),
    "stable_baselines3": ("gym/",),
    "xarray": ("trajectories.py",),
    "franky": ("execution/drivers/franka.py",),
    "roslibpy": ("execution/drivers/rosbridge.py",),
    "ray": ("sweeps/on_ray.py",),
    "optuna": ("sweeps/search.py",),
}


def imports(path: Path) -> Iterator[str]:
    """Every absolute dotted name imported anywhere in a file, inside functions and type checks too."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def may_import(part: str, other: str) -> bool:
    """Whether a room, or a module at the top, may import another one."""
    if other in {part, "__version__"} or part == "__init__":  # the door: it names what is public, wherever that is
        return True
    here, there = FLOOR.get(part, 0), FLOOR.get(other, 0)
    return there < here and other not in KEPT_APART.get(part, ()) if here else there == 0


def test_no_import_points_up_or_sideways() -> None:
    wrong = []
    for path in ROOT.rglob("*.py"):
        name = path.relative_to(ROOT).as_posix()
        part = name.removesuffix(".py").split("/")[0]
        for imported in imports(path):
            package, *rest = imported.split(".")
            if package == "skillcli" and not may_import(part, rest[0]):
                wrong.append(f"{name} imports {imported}")
            if package in ONLY_IN and not name.startswith(ONLY_IN[package]):
                wrong.append(f"{name} imports {imported}")
    assert not wrong, "\n".join(wrong)


def test_no_stage_imports_another_except_in_the_chain_and_a_sweep_the_chain() -> None:
    modules = [path.stem for path in (ROOT / "stages").glob("*.py") if path.stem != "chain"]
    wrong = [
        f"{name} imports {imported}"
        for name in modules
        for imported in imports(ROOT / "stages" / f"{name}.py")
        if imported.startswith("skillcli.stages") and (name, imported) != ("sweep", "skillcli.stages.chain.run_chain")
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("words", [(), ("compose",), ("upload",)])
def test_help_loads_nothing_heavy(words: tuple[str, ...]) -> None:
    code = (
        f"import sys; sys.argv = ['skill', *{words}, '--help']\n"
        "from skillcli.cli.app import main\n"
        "try: main()\n"
        "except SystemExit as leaving: assert not leaving.code\n"
        "heavy = {'torch', 'mujoco', 'h5py', 'rerun', 'matplotlib', 'scipy', 'numpy', 'onnx', 'fsspec'}\n"
        "heavy |= {'gymnasium', 'xarray', 'ray', 'optuna', 'viser'}\n"
        "heavy &= set(sys.modules)\n"
        "sys.exit(f'loaded {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


def test_recipes_and_methods_are_read_without_torch() -> None:
    code = "import sys, skillcli.recipe; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60).returncode == 0, "every method is imported there"
