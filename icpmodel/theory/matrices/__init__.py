"""Matrix classes, each decided with a reason and a witness, and what the decisions are made of."""
