"""Benchmarks: how this program compares with the usual way to do the same, in ratios on one machine.

`tools/benchmark NAME` imports `benchmarks.NAME` and nothing of the others; each module of this folder is a benchmark,
and has

    __doc__                      a line that says what is compared; then more of it; the last two paragraphs are
                                 `Takes …` (its time) and `Target: …`
    run(options) -> Report       measures; the options are those below and its own; raises `BenchmarkError`
    add_options(parser)          only where it has options of its own

Every benchmark has `options.quick` (fewer rounds: right in form, rough in numbers). Seconds are never asserted: a
target that is missed is said in the table. Contestants take turns in one process (`parts.timing.interleaved`), so that
a loaded machine shifts both sides of a ratio.
"""
