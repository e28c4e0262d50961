"""Coverage-guided fuzzing: inputs that nobody would think of, for everything that reads foreign bytes.

`tools/fuzz TARGET` imports `fuzzing.TARGET` and nothing of the others; each module of this folder is a target, and has

    __doc__         what is read, and the law that holds for any bytes; its first line goes into the help
    run(data)       reads the bytes as the program would; whatever it raises is a finding
    seeds()         good inputs to begin with
    LENGTH          bytes of an input at most

Errors that a reader documents are caught by `run` and are no findings; neither is a value that says "refused". What
is found is kept in tests/corpus/TARGET as `open-…`. Once it is fixed, the file is renamed, and
tests/tools/test_fuzz.py replays it.
"""
