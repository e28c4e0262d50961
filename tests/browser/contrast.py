"""The contrast of the page's texts with what is behind them, as WCAG 2 defines it."""

from playwright.sync_api import Page

_FIND = """selector => {
    const numbers = text => text.match(/[0-9.]+/g).map(Number);
    const light = rgb => rgb.slice(0, 3).map(part => part / 255).map(
        part => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4).reduce(
        (sum, part, k) => sum + part * [0.2126, 0.7152, 0.0722][k], 0);
    const found = [];
    for (const each of document.querySelectorAll(selector)) {
        const own = [...each.childNodes].some(node => node.nodeType === 3 && node.data.trim());
        if (!own || !each.getClientRects().length) continue;
        let opacity = 1, back = null, hasPicture = false;
        for (let at = each; at && back === null; at = at.parentElement) {
            const style = getComputedStyle(at);
            opacity *= style.opacity;
            hasPicture = hasPicture || style.backgroundImage !== "none";
            const color = numbers(style.backgroundColor);
            if (color.length === 3 || color[3] === 1) back = color;
        }
        if (back === null || hasPicture || opacity === 0) continue;  // viser fades its own settings out
        const text = numbers(getComputedStyle(each).color).slice(0, 3);
        const mixed = text.map((part, k) => part * opacity + back[k] * (1 - opacity));
        const [low, high] = [light(mixed), light(back)].sort((a, b) => a - b);
        found.push([each.textContent.trim().slice(0, 30), (high + 0.05) / (low + 0.05)]);
    }
    return found;
}"""


def read_contrasts(page: Page, selector: str) -> dict[str, float]:
    """Return the contrast of each text in the elements that `selector` finds, where the colour behind it is known."""
    found: list[tuple[str, float]] = page.evaluate(_FIND, selector)
    return dict(found)
