"""The documentation site builds without a warning, its links lead somewhere, and it needs no other host."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from .tools.running import run_module

ROOT = Path(__file__).resolve().parents[1]
ADDRESSES = {"href", "src", "srcset", "poster", "data"}
LOADED = {"link", "script", "img", "source", "iframe", "object", "embed", "video", "audio"}
"""Elements whose address the browser fetches without being asked."""


class Page(HTMLParser):
    """Anchors and addresses of one page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.anchors, self.links, self.loaded = {""}, list[str](), list[str]()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect."""
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.anchors.add(value)
            elif name in ADDRESSES and value is not None:
                (self.loaded if tag in LOADED else self.links).append(value)


def build(out: Path) -> str:
    """What the build of the site into `out` printed."""
    done = run_module("docs_site", "--out", str(out), cwd=out)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site."""
    out = tmp_path_factory.mktemp("docs")
    output = build(out)
    assert "No issues found" in output
    assert not re.search(r"warn|error|mkdocstrings:|griffe", output, re.IGNORECASE), output
    return out / "site"


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    """Every page of the site."""
    return {path: Page(path) for path in sorted(site.rglob("*.html"))}


def is_outside(address: str) -> bool:
    """Whether another host is asked for it."""
    return bool(urlsplit(address).netloc)


def test_every_internal_link_and_anchor_leads_somewhere(pages: dict[Path, Page]) -> None:
    broken, followed = [], 0
    for path, page in pages.items():
        if path.name == "404.html":  # served from anywhere, so its addresses are not relative to a file
            continue
        for address in (*page.links, *page.loaded):
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            followed += 1
            if not target.is_file() or (target in pages and unquote(parts.fragment) not in pages[target].anchors):
                broken.append(f"{path.name}: {address}")
    assert followed > 500
    assert broken == []


def test_no_page_needs_another_host(site: Path, pages: dict[Path, Page]) -> None:
    outside = [(path.name, address) for path, page in pages.items() for address in page.loaded if is_outside(address)]
    styles = [(path.name, path.read_text(encoding="utf-8")) for path in site.rglob("*.css")]
    styles += [(path.name, path.read_text(encoding="utf-8")) for path in pages]
    asked = r"(?:url\(|@import\s)\s*[\"']?(?:https?:)?//[^)\"';]+"
    outside += [(name, address) for name, text in styles for address in re.findall(asked, text)]
    assert outside == []


def test_every_public_name_is_in_the_api_reference(pages: dict[Path, Page]) -> None:
    import vehicle_iface
    from vehicle_iface import errors

    anchors = next(page for path, page in pages.items() if path.name == "api.html").anchors
    classes = [name for name, value in vars(errors).items() if isinstance(value, type)]
    wanted = {f"vehicle_iface.{name}" for name in vehicle_iface.__all__}
    wanted |= {f"vehicle_iface.errors.{name}" for name in classes}
    assert len(classes) > 5
    assert wanted - anchors == set()


def test_a_broken_link_fails_the_build(tmp_path: Path) -> None:
    out = tmp_path / "out"
    (out / "pages").mkdir(parents=True)
    (out / "zensical.toml").write_text('[project]\nsite_name = "x"\ndocs_dir = "pages"\nsite_dir = "site"\n')
    (out / "pages" / "index.md").write_text("# A page\n\n[nowhere](nowhere.md)\n")
    command = [sys.executable, "-m", "zensical", "build", "--strict", "--config-file", str(out / "zensical.toml")]
    assert subprocess.run(command, cwd=out, capture_output=True, timeout=60).returncode != 0
