"""Benchmarks of ecatd and ecatsim: `make bench`, or `python -m benchmarks --help`.

Each benchmark is a module with three functions: `measure(settings)` returns what was measured as
data for JSON, `section(result)` says it in Markdown, `plot(result, path)` draws it.
"""
