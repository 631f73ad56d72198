"""Render the page from its template. Texts from artifacts are escaped; figures are data URLs, which cannot run code."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from importlib.resources import files

from jinja2 import Environment, StrictUndefined

from skillcli.viz.report.content import Page

PRINTED = "addEventListener('beforeprint', () => document.querySelectorAll('details').forEach(d => { d.open = true }))"


def render(page: Page) -> str:
    """Render the page as HTML."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"anchor": anchor, "picture": picture}
    template = environment.from_string((files(__package__) / "page.html").read_text(encoding="utf-8"))
    allowed = b64encode(hashlib.sha256(PRINTED.encode()).digest()).decode()
    text = template.render(page=page, script=PRINTED, script_hash=allowed)
    # an address in a command or a recipe must not become a link
    return text.replace("://", ":&#47;&#47;")


def anchor(artifact_id: str) -> str:
    """Return the HTML id of an artifact."""
    return "artifact-" + artifact_id.replace("/", "--")


def picture(svg: bytes) -> str:
    """Encode an SVG figure as a data URL for an image, so that nothing in it can run."""
    return "data:image/svg+xml;base64," + b64encode(svg).decode()
