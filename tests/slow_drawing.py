"""A script for pages in tests that slows their drawing down.

The scene of the live page, drawn in software at 60 pictures a second, costs more than half a processor; a few are
enough. Pages from a file have no scene and are drawn as usual.
"""


def slow_drawing(pause_ms: int) -> str:
    """Return the script; the page waits for so long before each picture."""
    return f"""
if (location.protocol === "http:") {{
    const soon = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (draw) => window.setTimeout(() => soon(draw), {pause_ms});
    window.cancelAnimationFrame = (number) => window.clearTimeout(number);
}}
"""
