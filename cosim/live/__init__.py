"""A run on a page while it goes on: what its viewers get, the server of it, and an observer for both."""
