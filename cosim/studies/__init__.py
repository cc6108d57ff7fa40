"""Many runs of one scenario: what varies, how it is sampled, and what must hold of all runs together."""
