"""The viewer's page, made from a telemetry file.

Law: the page is drawn whatever is in the file, and nothing in the file becomes a tag of it.
"""

from html.parser import HTMLParser

from fuzzing import _tampered
from vehicle_iface.runtime.telemetry import TelemetryReader
from viewer import panels, scene
from viewer.feed import Feed, View

LENGTH = 1024
seeds = _tampered.seeds
_TAGS = {"div", "span", "table", "tr", "td", "i", "br", "b", "small"}
_NOW_NS = 10**8


class _Tags(HTMLParser):
    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in _TAGS, tag
        assert not any(name.startswith("on") or name in ("src", "href") for name, _ in attrs)


def run(data: bytes) -> None:
    with TelemetryReader(str(_tampered.tampered(data))) as reader:
        feed = Feed(reader)
        for now_ns in (_NOW_NS, _NOW_NS + 10**9):
            _draw(feed.view(now_ns))


def _draw(view: View) -> None:
    tags = _Tags()
    tags.feed(panels.banner_html(view))
    tags.feed(panels.numbers_html(view))
    tags.feed(panels.legend_html(view))
    tags.feed(panels.details_html(view))
    tags.close()
    if view.trajectory is not None:
        scene.drawable_points(view.trajectory, (0.0, 0.0))
