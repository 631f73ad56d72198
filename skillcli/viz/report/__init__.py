"""One HTML page that stands alone: no link, script, font or picture from anywhere else."""

from __future__ import annotations

from skillcli.viz.report.page import render

__all__ = ["render"]
