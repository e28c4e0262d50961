"""The cover of a page that is no longer updated.

A browser keeps the last content of a page whose viewer has died or hangs. Each update replaces the cover by a new one,
which a CSS animation shows after a while; no script is needed.
"""


def cover_html(number: int) -> str:
    """Return the cover; another number makes the browser replace it."""
    return (
        f'<div id="frozen" data-number="{number}"><b>THIS PAGE IS FROZEN</b>'
        "<span>The viewer does not update it: nothing on it is current. Watch the vehicle, and restart "
        "<code>vehicle-iface view</code>.</span></div>"
    )
