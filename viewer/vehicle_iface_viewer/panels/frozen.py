"""The cover of a page that is no longer updated.

A browser keeps the last content of a page whose viewer has died or hangs. Each update replaces the cover by a new one,
which a CSS animation shows after a while; no script is needed.
"""

FROZEN_AFTER_S = 1.2
STYLE = f"""<style>
#way-on code {{ white-space: nowrap }}
@keyframes frozen {{ to {{ visibility: visible }} }}
#frozen {{ position: fixed; inset: 0; z-index: 10000; visibility: hidden; pointer-events: none;
  animation: frozen 0s {FROZEN_AFTER_S}s forwards; display: flex; flex-direction: column; justify-content: center;
  padding: 24px; text-align: center; background: rgba(92, 0, 0, .93); color: #fff; font-size: 16px; line-height: 1.4 }}
#frozen b {{ font-size: clamp(30px, 7vw, 76px); line-height: 1.1; letter-spacing: 1px }}
</style>"""


def cover_html(number: int) -> str:
    """Return the cover; another number makes the browser replace it."""
    return (
        f'<div id="frozen" data-number="{number}"><b>THIS PAGE IS FROZEN</b>'
        "<span>The viewer does not update it: nothing on it is current. Watch the vehicle, and restart "
        "<code>vehicle-iface view</code>.</span></div>"
    )
