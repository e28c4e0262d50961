"""Mutation testing of the product: small changes of its code, and whether a test fails for each."""
