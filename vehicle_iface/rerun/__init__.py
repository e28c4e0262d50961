"""Runs a recorded drive again: the inputs of the loop are recorded exactly, and fed to the code of today.

`tap` is the loop's side, `recorder.inputs_tap` writes what comes from it, `replayed` gives it back to a loop, and
`drive` compares what that loop sends.
"""
