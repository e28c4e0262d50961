"""Wait for something on the page that may not be drawn yet."""

from typing import Literal

from playwright.sync_api import Page


def wait_until(page: Page, holds: str, arg: object = None, polling: float | Literal["raf"] = "raf") -> None:
    """Wait until the JavaScript function `holds` returns true.

    An element that is not on the page yet (a property of null) counts as "not yet", not as an error.
    """
    patient = f"""arg => {{
        try {{ return ({holds})(arg); }}
        catch (error) {{ if (error instanceof TypeError) return false; throw error; }} }}"""
    page.wait_for_function(patient, arg=arg, polling=polling)
