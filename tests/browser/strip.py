"""A click into a strip of the page."""

from playwright.sync_api import Page


def click_strip(page: Page, name: str, share: float) -> None:
    """Click at a share of the strip's width from its left end."""
    slider = page.locator(f"div:has(> #strip-{name}) + div .mantine-Slider-trackContainer")
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    assert box is not None
    slider.click(position={"x": share * box["width"], "y": 10}, force=True)
