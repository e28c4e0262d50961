"""The table of all messages on the vehicle's buses, from a listener that is a process of its own.

The listener has raw sockets that send nothing, and decodes what it receives with the profile's DBCs. The loop does not
know of it, and neither its load nor a DBC that takes long to read delays the page.
"""
