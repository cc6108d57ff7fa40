"""Scenarios: the language of their files, and what a file says as plain data."""
