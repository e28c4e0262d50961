"""Copies the project's Markdown files into one folder of pages, with links that fit there."""

import posixpath
import re
import shutil
from pathlib import Path

ELSEWHERE = {
    "README.md": "index.md",
    "ARCHITECTURE.md": "architecture.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "dbc/README.md": "reference-vehicle.md",
    "vehicle_iface/CONVENTIONS.md": "conventions.md",
    "vehicle_iface/FAILURES.md": "failures.md",
}
"""Files outside `docs/`, below the root, and the page that each becomes."""
COPIED = {".md", ".png", ".css", ".js"}
SHOWN = {".py": "python", ".dbc": "text", ".toml": "toml", ".csv": "text"}
"""Suffix of an example's file, and the language in which its page shows it."""
LINK = re.compile(r"(?<!!)\[(?P<text>[^\]\n]*)\]\((?P<target>[^)\s]+)\)|(?P<image>!\[[^\]]*\])\((?P<file>[^)\s]+)\)")
CODE = re.compile(r"^( *)```.*?^\1```|`[^`\n]*`(?!\])", re.MULTILINE | re.DOTALL)


def copy_pages(root: Path, pages: Path) -> None:
    """Fill the folder `pages` from the project at `root`; what was in it is removed."""
    shutil.rmtree(pages, ignore_errors=True)
    page_of = pages_by_file(root)
    for file, page in page_of.items():
        target = pages / page
        target.parent.mkdir(parents=True, exist_ok=True)
        if file.endswith(".md"):
            source = (root / file).read_text(encoding="utf-8")
            target.write_text(with_links_of_site(source, file, page_of, root), encoding="utf-8")
        elif page.endswith(".md"):
            target.write_text(_listing(root / file), encoding="utf-8")
        else:
            shutil.copyfile(root / file, target)


def pages_by_file(root: Path) -> dict[str, str]:
    """Each file of the site, and its page, both relative: to the root of the project, and to that of the site."""
    found = dict(ELSEWHERE)
    for path in sorted((root / "docs").rglob("*")):
        page = path.relative_to(root / "docs").as_posix()
        if path.suffix in COPIED:
            found[f"docs/{page}"] = re.sub(r"README\.md$", "index.md", page)
        elif path.suffix in SHOWN and page.startswith("examples/"):
            found[f"docs/{page}"] = f"{page}.md"
    return found


def with_links_of_site(source: str, file: str, page_of: dict[str, str], root: Path) -> str:
    """The Markdown of `file` with its links changed to pages; a link to a file without a page becomes its name."""
    codes: list[str] = []

    def hide(match: re.Match[str]) -> str:
        codes.append(match.group())
        return f"\0{len(codes) - 1}\0"

    def link(match: re.Match[str]) -> str:
        text, target, image, name = match.group("text", "target", "image", "file")
        path, hash_sign, anchor = (target or name).partition("#")
        if "://" in path or not path:
            return match.group()
        linked = posixpath.normpath(posixpath.join(posixpath.dirname(file), path))
        linked = f"{linked}/README.md" if (root / linked / "README.md").is_file() else linked
        if linked in page_of:
            place = posixpath.relpath(page_of[linked], posixpath.dirname(page_of[file]) or ".")
            return f"{image or f'[{text}]'}({place}{hash_sign}{anchor})"
        return f"`{linked}`" if (root / linked).exists() else match.group()

    changed = LINK.sub(link, CODE.sub(hide, source))
    return re.sub(r"\0(\d+)\0", lambda match: codes[int(match.group(1))], changed)


def _listing(path: Path) -> str:
    """A page that shows one file."""
    return f"# {path.name}\n\n```{SHOWN[path.suffix]}\n{path.read_text(encoding='utf-8').rstrip()}\n```\n"
