"""The style sheet of the panel, for what an element's own style cannot say."""

FROZEN_AFTER_S = 1.2
"""The cover appears when it was not replaced for this long (see `frozen`)."""
# viser's sheet on a phone is as wide as its panel on a large screen, 20em, and begins at the right.
_PHONE = "@media (max-width: 576px)"
STYLE = f"""<style>
@keyframes frozen {{ to {{ visibility: visible }} }}
#frozen {{ position: fixed; inset: 0; z-index: 10000; visibility: hidden; pointer-events: none;
  animation: frozen 0s {FROZEN_AFTER_S}s forwards; display: flex; flex-direction: column; justify-content: center;
  padding: 24px; text-align: center; background: rgba(92, 0, 0, .93); color: #fff; font-size: 16px; line-height: 1.4 }}
#frozen b {{ font-size: clamp(30px, 7vw, 76px); line-height: 1.1; letter-spacing: 1px }}
#way-on code {{ white-space: nowrap }}
.uplot .u-legend .u-series:nth-last-child(-n+3) {{ display: none }}
{_PHONE} {{ .mantine-Paper-root:has(#banner), .mantine-Paper-root:has(#banner) [style*="width: 20em"] {{
  left: 0 !important; width: 100% !important; max-width: none !important }} }}
</style>"""
