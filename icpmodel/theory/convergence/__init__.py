"""Does a method of the modulus family converge on this problem, and how fast? The theorems as checks."""
