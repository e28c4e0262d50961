"""The viewer's page, made from a telemetry file.

Law: the page is drawn whatever is in the file, and nothing in the file becomes a tag of it.
"""

from html.parser import HTMLParser

from fuzzing.engine import tampered
from vehicle_iface_viewer.feed import Feed, LiveTelemetry, View
from vehicle_iface_viewer.panels.banner import banner_html
from vehicle_iface_viewer.panels.counters import counters_html
from vehicle_iface_viewer.panels.legend import legend_html
from vehicle_iface_viewer.panels.numbers import numbers_html
from vehicle_iface_viewer.scene.trajectory_path import select_drawable

LENGTH = 1024
seeds = tampered.seeds
_TAGS = {"div", "span", "table", "tr", "td", "i", "br", "b", "small"}
_NOW_NS = 10**8


class _Tags(HTMLParser):
    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in _TAGS, tag
        assert not any(name.startswith("on") or name in ("src", "href") for name, _ in attrs)


def run(data: bytes) -> None:
    with LiveTelemetry(str(tampered.tampered(data))) as reader:
        feed = Feed(reader)
        for now_ns in (_NOW_NS, _NOW_NS + 10**9):
            _draw(feed.read(now_ns))


def _draw(view: View) -> None:
    tags = _Tags()
    tags.feed(banner_html(view))
    tags.feed(numbers_html(view))
    tags.feed(legend_html(view))
    tags.feed(counters_html(view))
    tags.close()
    if view.trajectory is not None:
        select_drawable(view.trajectory, (0.0, 0.0))
