"""The master: a scenario is prepared, its robots become plants of a fleet, and the loop runs."""
