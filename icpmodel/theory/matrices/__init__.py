"""Matrix classes, each decided with a reason and a witness, and the tests that decide."""
