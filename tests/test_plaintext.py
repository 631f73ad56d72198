"""Text that is harmless stays as it is; whatever acts on a terminal or in Markdown is written out."""

from skillcli.plaintext import code, line, markdown, visible


def test_text_that_is_harmless_stays_as_it_is() -> None:
    assert visible("grün 力\n\t[x]\N{NO-BREAK SPACE}…") == "grün 力\n\t[x]\N{NO-BREAK SPACE}…"
    assert visible("\x1b\x9b\u202e\udc9b") == r"\x1b\x9b\u202e\udc9b"
    assert line("a\n b\r\n\x00") == r"a b \x00"
    assert markdown("[a](b) *c*") == r"\[a\]\(b\) \*c\*"
    assert code("a ``b`` c") == "``` a ``b`` c ```"
