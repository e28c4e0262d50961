"""Reports of a run, made from `result` alone.

    Run ──▶ html      one self-contained page
        ──▶ junit     XML for a CI
        ──▶ terminal  progress and summary
        ──▶ compare   differences from an earlier run

Everything in a run came from a bus, a DBC, a file or a device: it is text, never markup, and goes through `formatting`.
"""
