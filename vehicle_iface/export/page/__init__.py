"""One self-contained HTML page of recorded drives, which plays without a server and asks the network for nothing.

`drive` turns a recording into the data of `model`, `render` writes the page around it. The same page shows one drive,
two drives side by side, or the differences of a rerun: it knows curves, events and states, not where they come from.
"""
