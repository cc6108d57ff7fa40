"""Fuzzers: mutated scenarios and FMUs, of which nothing may come but results and proper refusals."""
