"""The style sheet of the panel, for what an element's own style cannot say."""

FROZEN_AFTER_S = 1.2
"""The cover appears when it was not replaced for this long (see `frozen`)."""
# viser's sheet on a phone is as wide as its panel on a large screen, 20em, and begins at the right.
_PHONE = "@media (max-width: 576px)"
# viser puts each element of the panel into a box of its own: a slider that follows a strip is laid over it.
_OVER = "div:has(> .vi-strip) + div"
# Small text has a contrast of at least 4.5 on the dark page and on the light one.
# viser handles messages when it draws its canvas, so that stays below the map, with nothing in it.
STYLE = f"""<style>
:root[data-mantine-color-scheme="dark"][lang] {{
  --vi-bad: #ff6b6b; --vi-new: #74c0fc; --mantine-color-dimmed: #adb5bd }}
:root[data-mantine-color-scheme="light"][lang] {{
  --vi-bad: #c92a2a; --vi-new: #1864ab; --mantine-color-dimmed: #495057 }}
@keyframes frozen {{ to {{ visibility: visible }} }}
#frozen {{ position: fixed; inset: 0; z-index: 10000; visibility: hidden; pointer-events: none;
  animation: frozen 0s {FROZEN_AFTER_S}s forwards; display: flex; flex-direction: column; justify-content: center;
  padding: 24px; text-align: center; background: rgba(92, 0, 0, .93); color: #fff; font-size: 16px; line-height: 1.4 }}
#frozen b {{ font-size: clamp(30px, 7vw, 76px); line-height: 1.1; letter-spacing: 1px }}
#way-on code {{ white-space: nowrap }}
.uplot .u-legend .u-series:nth-last-child(-n+3) {{ display: none }}
.uplot .u-legend .u-series {{ margin-right: 0 !important; letter-spacing: -.2px }}
.uplot .u-legend .u-value {{ display: inline-block; min-width: 3.3em; font-variant-numeric: tabular-nums;
  text-align: left; color: inherit }}
.uplot .u-legend .u-series:first-child th {{ display: none }}
.uplot .u-legend .u-series:first-child .u-value::after {{ content: " s" }}
.vi-note {{ margin: 4px 8px; font-size: 12px; opacity: .8 }}
.vi-signals, .vi-values, .vi-bar {{ font-size: 12px; line-height: 1.35; font-variant-numeric: tabular-nums }}
.vi-message {{ margin: 0 14px 6px 6px }}
.vi-faulty {{ box-shadow: -3px 0 0 var(--vi-bad) }}
.vi-head {{ background: rgba(128,128,128,.2); padding: 1px 4px; font-size: 12.5px }}
.vi-facts {{ padding: 0 4px; font-size: 11px; opacity: .8 }}
.vi-message > div, .vi-values > div, .vi-bar {{ display: flex; justify-content: space-between; gap: 8px;
  padding: 0 4px }}
.vi-message > .vi-facts, .vi-message > .vi-data {{ display: block }}
.vi-message > div > :first-child {{ overflow: hidden; text-overflow: ellipsis; white-space: nowrap }}
.vi-message > div > :last-child {{ white-space: nowrap }}
.vi-message > .vi-facts > * {{ white-space: normal }}
.vi-data {{ font-family: monospace; font-size: 11px; word-break: break-all }}
.vi-message i {{ font-style: normal; opacity: .85 }}
.vi-bad {{ color: var(--vi-bad); font-weight: 700; opacity: 1 }}
.vi-old {{ opacity: .62 }}
.vi-new {{ color: var(--vi-new) }}
.vi-event {{ display: flex; gap: 8px; margin: 0 14px 3px 6px; padding-left: 6px; font-size: 12px; line-height: 1.35;
  font-variant-numeric: tabular-nums }}
.vi-values, .vi-bar {{ margin-right: 10px }} .vi-values {{ margin-bottom: 8px }}
.vi-bar > :first-child {{ width: 92px }} .vi-bar > :nth-child(2) {{ flex: 1 }}
.vi-bar u {{ display: block; height: 9px; margin-top: 3px; background: #4dabf7 }}
.vi-strip {{ margin: 0 14px 6px 8px; font-size: 11.5px; line-height: 1.3; font-variant-numeric: tabular-nums }}
.vi-strip svg {{ display: block; width: 100%; height: 32px; border-radius: 3px; fill: none;
  background: linear-gradient(#212529, #212529) 0 100% / 100% 11px no-repeat,
  repeating-linear-gradient(135deg, #343a40 0 4px, #212529 4px 8px) }}
.vi-strip > div {{ display: flex; justify-content: space-between; gap: 10px; padding-top: 1px }}
.vi-strip i {{ display: inline-block; width: 8px; height: 8px; margin-right: 4px; outline: 1px solid #868e96 }}
{_OVER} {{ position: relative; z-index: 2; height: 32px; margin: -53px 14px 21px 8px; padding: 0 !important }}
{_OVER} label, {_OVER} .mantine-NumberInput-root, {_OVER} .mantine-Slider-markWrapper {{ display: none }}
{_OVER} > div > :first-child {{ display: none }}
{_OVER} .mantine-Slider-root {{ --slider-size: 0px !important; height: 32px; padding: 0 !important }}
{_OVER} .mantine-Slider-trackContainer, {_OVER} .mantine-Slider-track {{ height: 32px; cursor: pointer }}
{_OVER} .mantine-Slider-track::before, {_OVER} .mantine-Slider-bar {{ background: none }}
{_OVER} .mantine-Slider-thumb {{ width: 4px !important; height: 36px !important; border-radius: 2px;
  border: none; background: #fff !important; outline: 1px solid #000 }}
.vi-loops {{ margin: 4px 14px 4px 8px; padding: 2px 14px 4px; border: 2px solid #868e96; border-radius: 8px;
  font-size: 13px; line-height: 1.5 }}
.vi-loops > b {{ font-size: 22px; line-height: 1.3; overflow-wrap: anywhere }}
.vi-loop i {{ color: #fff; font-style: normal; font-size: 11px; font-weight: 700; border-radius: 4px;
  padding: 1px 6px }}
.vi-beside {{ font-size: 12px; margin-left: 12px }}
#beside i {{ display: inline-block; width: 10px; height: 10px; margin-right: 6px }}
.vi-beside a, .vi-loop a {{ font-weight: 700; color: var(--vi-new) }}
.vi-map {{ display: block; width: calc(100% - 14px); height: max(calc(50vh - 90px), 150px);
  margin-left: 6px }}
#big-map {{ position: fixed; inset: 0 auto 0 var(--vi-left, 0); width: var(--vi-width, 0); overflow: hidden;
  display: flex; flex-direction: column; background: var(--mantine-color-body) }}
#big-map > .vi-map {{ flex: 1; min-height: 0; margin: 0 auto }}
#big-map text {{ transform: scale(.6); transform-box: fill-box; transform-origin: 0 100% }}
#big-map > .vi-note {{ margin: 14px 18px 0; font-size: 14px; opacity: 1 }}
.vi-phone {{ display: none }}
{_PHONE} {{ #big-map {{ display: none }} }}
{_PHONE} {{ .vi-phone {{ display: block }} .vi-phone > .vi-map {{ height: 220px }} }}
{_PHONE} {{ .mantine-Paper-root:has(#banner), .mantine-Paper-root:has(#banner) [style*="width: 20em"] {{
  left: 0 !important; width: 100% !important; max-width: none !important }} }}
</style>"""
