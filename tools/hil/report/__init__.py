"""What a person, a terminal and a CI make of a run: all from `result` alone.

    Run ──▶ html      one page that stands by itself
        ──▶ junit     XML for a CI
        ──▶ terminal  while it runs, and the end of it
        ──▶ compare   this run beside an older one

Whatever stands in a run came from a bus, a DBC, a file or a device: it is text, never markup, and goes through `words`.
"""
