"""The faults that the bench injects, by where they act: each a context that begins the fault and ends it.

A context is entered while the vehicle drives. The fault begins with the entry, unless the context calls
`rig.mark_injection` itself. No context blocks: the vehicle keeps its period meanwhile.
"""
