"""The page out of its template. Everything from an artifact is escaped; pictures are data, which no text can break out of."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from importlib.resources import files

from jinja2 import Environment, StrictUndefined

from skillcli.viz.report.content import Page

PRINTED = "addEventListener('beforeprint', () => document.querySelectorAll('details').forEach(d => { d.open = true }))"


def render(page: Page) -> str:
    """The page as HTML."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"anchor": anchor, "picture": picture}
    template = environment.from_string((files(__package__) / "page.html").read_text(encoding="utf-8"))
    allowed = b64encode(hashlib.sha256(PRINTED.encode()).digest()).decode()
    text = template.render(page=page, script=PRINTED, script_hash=allowed)
    # an address in a command or a recipe stays readable, and nothing takes it for a link
    return text.replace("://", ":&#47;&#47;")


def anchor(artifact_id: str) -> str:
    """The name of an artifact's place on the page."""
    return "artifact-" + artifact_id.replace("/", "--")


def picture(svg: bytes) -> str:
    """A drawing as an address that holds all of it; as an image, so that nothing in it can be run."""
    return "data:image/svg+xml;base64," + b64encode(svg).decode()
