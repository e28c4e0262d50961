"""Tests of the promises of FAILURES.md: a defect for each, and whether a test of its row fails."""
