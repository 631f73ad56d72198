"""One HTML page without external files: no link, script, font or image from elsewhere."""

from __future__ import annotations

from skillcli.viz.report.page import render

__all__ = ["render"]
