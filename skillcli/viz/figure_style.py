"""The common style of all figures: size, fonts, legends, and encoding; equal figures give equal bytes."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from skillcli.viz.palette import look

DPI = 200
WIDTH = 6.3  # inches, the text width of a page
STYLE: Any = {  # matplotlib types the keys as one literal of all its settings
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "legend.handlelength": 2.6,
    "lines.linewidth": 1.4,
    "pdf.fonttype": 42,  # text stays text, so that a journal can embed the font
    "svg.hashsalt": "skill",  # equal figures give equal files
}
UNUSED = ("backend", "backend_fallback")  # settings without effect: nothing here opens a window


@contextmanager
def styled() -> Iterator[None]:
    """Make and write figures inside this block, with these settings and no others."""
    theirs, ours = matplotlib.rcParams, matplotlib.rcParamsDefault
    changed = {key: value for key, value in ours.items() if key not in UNUSED and theirs[key] != value}
    with matplotlib.rc_context({**changed, **STYLE}), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a character that the font lacks is drawn as a box
        warnings.filterwarnings("ignore", "constrained_layout not applied")  # a long name may leave no room for the axes
        yield


def blank(width: float, height: float) -> Figure:
    """Make an empty figure in inches, without a window."""
    figure = Figure((width, height), layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06, wspace=0.03, hspace=0.04))
    FigureCanvasAgg(figure)
    return figure


def encoded(figure: Figure, suffix: str) -> bytes:
    """Encode the figure as one of `files.FORMATS`, without a date. The first call computes the layout, which is then kept."""
    dated: dict[str, dict[str, Any]] = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
    stream = io.BytesIO()
    figure.savefig(stream, format=suffix, dpi=DPI, metadata=dated[suffix])
    figure.set_layout_engine("none")
    return stream.getvalue()


def skill_handles(names: Iterable[tuple[int, str]], marked: bool = True) -> list[Line2D]:
    """Make legend entries for skills: index (-1: between skills) and name; `marked` if markers are drawn too."""
    looks = [(look(skill), name) for skill, name in names]
    return [
        Line2D([], [], color=each.color, ls=each.dash, marker=each.marker if marked else "", ms=4, label=name)
        for each, name in looks
    ]


def mark(label: str, marker: str, filling: str = "black", color: str = "black", size: float = 4) -> Line2D:
    """Make a legend entry that is a single mark."""
    return Line2D([], [], color=color, ls="none", marker=marker, mfc=filling, ms=size, mew=0.8, label=label)


def legend(figure: Figure, handles: Sequence[Artist], width: int = 105) -> None:
    """Put a legend below everything, in as many columns as fit into `width` characters."""
    longest = max((len(str(handle.get_label())) for handle in handles), default=1)
    columns = max(1, min(len(handles), int(width / (longest + 9))))
    figure.legend(handles=[*handles], loc="outside lower center", ncols=columns)
