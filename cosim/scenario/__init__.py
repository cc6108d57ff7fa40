"""Scenarios: the language of their files, and the content of a file as plain data."""
