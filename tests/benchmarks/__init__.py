"""The measurements of the documentation, one module per table: `python tests/benchmarks NAME`."""
