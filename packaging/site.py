"""Hooks of MkDocs: pages that are above `docs/`, and links that lead out of it."""

import json
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[1]
ABOVE = {
    "index.md": "README.md",
    "security.md": "SECURITY.md",
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
}
"""Pages of the site that are files above `docs/`."""


def on_config(config: MkDocsConfig) -> None:
    """Each version has a folder of its own, and a list beside them lets readers choose."""
    text = (ROOT / "daemon/ecatd/base/version.py").read_text()
    (version,) = re.findall(r'^VERSION = "(.*)"$', text, re.MULTILINE)
    site = Path(config.site_dir)
    config.site_dir = str(site / version)
    site.mkdir(parents=True, exist_ok=True)
    others = {path.parent.name for path in site.glob("*/index.html")}
    versions = [
        {"version": one, "title": one, "aliases": []}
        for one in sorted(others | {version}, key=_numbers, reverse=True)
    ]
    (site / "versions.json").write_text(json.dumps(versions))
    (site / "index.html").write_text(f'<meta http-equiv="refresh" content="0; url={version}/">\n')


def _numbers(version: str) -> list[int]:
    """For sorting: 0.10.0 comes after 0.9.0."""
    return [int(part) for part in re.findall(r"\d+", version)]


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that are above `docs/`."""
    for page, name in ABOVE.items():
        text = re.sub(r"\]\(docs/", "](", (ROOT / name).read_text())
        files.append(File.generated(config, page, content=text))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Links to pages above `docs/` lead to their place in the site; other files are only named."""
    for page, name in ABOVE.items():
        markdown = re.sub(rf"\]\((?:\.\./)?{name}", f"]({page}", markdown)
    return re.sub(r"\[([^\]]*)\]\(\.\./[^)]*\)", r"\1", markdown)
