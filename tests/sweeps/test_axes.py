"""What a sweep varies, as it is typed."""

from __future__ import annotations

import pytest

from skillcli.errors import UsageError
from skillcli.sweeps.axes import Choice, Span, axis, drawn, grid, seeds, split_values
from skillcli.sweeps.cell import cell_name, sweep_of


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("2,4", ["2", "4"]),
        (" 2 , 4 ", ["2", "4"]),
        ("[1,2,3]", ["[1,2,3]"]),
        ("[1,2],[3,4]", ["[1,2]", "[3,4]"]),
        ("[[1,2],[3]],[]", ["[[1,2],[3]]", "[]"]),
        ("{uniform=[0.9, 1.1]},{fixed=1}", ["{uniform=[0.9, 1.1]}", "{fixed=1}"]),
        ('"a,b",c', ['"a,b"', "c"]),
        ("'a\"[',b", ["'a\"['", "b"]),
        ('"a\\",b",c', ['"a\\",b"', "c"]),
        ("one", ["one"]),
    ],
)
def test_values_are_split_at_commas_outside_of_brackets_and_quotes(text: str, parts: list[str]) -> None:
    assert split_values(text) == parts


@pytest.mark.parametrize("text", ["[1,2", "1,2]", '"a,b', "[1}", "{a=[1}"])
def test_what_is_not_closed_is_refused(text: str) -> None:
    with pytest.raises(UsageError):
        split_values(text)


def test_an_axis_is_a_list_or_a_range() -> None:
    assert axis("task.box_size=[1,2,3],[2,2,2]") == Choice("task.box_size", ("[1,2,3]", "[2,2,2]"))
    assert axis("a.b=1..8") == Span("a.b", 1.0, 8.0, whole=True, log=False)
    assert axis("a.b=1e-4..1e-2:log") == Span("a.b", 1e-4, 1e-2, whole=False, log=True)
    for wrong in ("a.b", "=1", "a.b=", "a.b=1,,2", "a.b=1,1", "a.b=2..1", "a.b=0..1:log", "a.b=-..1"):
        with pytest.raises(UsageError):
            axis(wrong)


def test_hints_about_ranges_name_what_was_typed() -> None:
    for text, hint in (
        ("a=3..1", "write 1..3"),
        ("a=3..1:log", "write 1..3"),
        ("a=0..1:log", "give ends above 0, or leave out :log"),
        ("a=2..2", "give two different numbers, the lower one first"),
    ):
        with pytest.raises(UsageError) as refused:
            axis(text)
        assert refused.value.hint == hint


def test_seeds_are_numbers_and_ranges() -> None:
    assert seeds("0-3") == [0, 1, 2, 3] and seeds("7") == [7] and seeds("0,2,5-7") == [0, 2, 5, 6, 7]
    for wrong in ("", "a", "3-1", "0,0", "0-3,2", "-1", "1-", "0-99999999", "1.5"):
        with pytest.raises(UsageError):
            seeds(wrong)


def test_a_grid_combines_everything_the_last_key_fastest() -> None:
    assert grid([]) == [()]
    assert grid([axis("a=1,2"), axis("b=x,y")]) == [
        (("a", "1"), ("b", "x")), (("a", "1"), ("b", "y")), (("a", "2"), ("b", "x")), (("a", "2"), ("b", "y")),
    ]  # fmt: skip
    with pytest.raises(UsageError, match="stands twice"):
        grid([axis("a=1"), axis("a=2")])
    with pytest.raises(UsageError, match="no ranges"):
        grid([axis("a=1..2")])


def test_drawn_settings_differ_and_are_the_same_every_time() -> None:
    axes = [axis("a=1..100"), axis("b=1e-4..1e-2:log"), axis("c=x,y")]
    found = drawn(axes, 20)
    assert found == drawn(axes, 20) and len(set(found)) == 20
    for (_, a), (_, b), (_, c) in found:
        assert 1 <= int(a) <= 100 and 1e-4 <= float(b) <= 1e-2 and c in "xy"
    assert sorted(drawn([axis("a=1,2"), axis("b=x,y")], 4)) == grid([axis("a=1,2"), axis("b=x,y")])
    for wrong, count in (([], 1), ([axis("a=1,2")], 3), ([axis("a=1..3")], 4)):
        with pytest.raises(UsageError):
            drawn(wrong, count)


def test_names_of_cells_say_what_they_are() -> None:
    assert cell_name("grid", (), 3) == "grid.s3"
    assert cell_name("grid", (("training.iterations", "20"), ("training.rate", "3e-4")), 0) == "grid.iterations-20_rate-3e-4.s0"
    odd = cell_name("grid", (("task.box_size", "[1,2,3]"),), 1)
    assert odd != cell_name("grid", (("task.box_size", "[1,2,4]"),), 1) and odd.startswith("grid.") and odd.endswith(".s1")
    same = cell_name("grid", (("a.x", "1"), ("b.x", "2")), 0)
    assert same != cell_name("grid", (("a.x", "2"), ("b.x", "1")), 0)


def test_the_sweep_of_a_name_is_found_again() -> None:
    sweeps = frozenset({"grid", "my.grid"})
    for name, sweep in (("grid.s0", "grid"), ("grid.iterations-20.s7", "grid"), ("my.grid.rate-0.5.s1", "my.grid")):
        assert sweep_of(name, sweeps) == sweep
    for name in ("grid", "gridded.s0", "other.s0", "grid.iterations-20", "grid.sx"):
        assert sweep_of(name, sweeps) == ""
