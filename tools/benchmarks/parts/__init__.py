"""Parts of the benchmarks: contestants, measuring and reports."""
