"""Recordings of drives that Formation has not made, judged by the expectations of a scenario."""
