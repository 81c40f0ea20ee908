"""Whether what the package says is true, of problems drawn afresh, by a judge that shares nothing with its own."""
